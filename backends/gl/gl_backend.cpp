#include "backends/gl/gl_backend.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "backends/glsl/compute.h"

namespace voxspring::gl {
namespace {

/// The value of found_ until a check fails; then it is the number of the first check that failed, from 1.
constexpr GLuint never_found = std::numeric_limits<GLuint>::max();
constexpr GLuint found_binding = 3;  // as in shaders/divergence_check.comp

}  // namespace

GlBackend::GlBackend(const Options& options)
    : options_(options),
      formulation_(options.formulation),
      all_terms_(options.tuning.at("terms") == "all"),
      queue_(context_),
      begin_(make_query(context_)),
      end_(make_query(context_)) {}

std::string GlBackend::unsupported(const Problem& problem) const {
    context_.make_current();
    if (std::string why = Backend::unsupported(problem); !why.empty()) return why;
    if (std::string why = refused(problem); !why.empty()) return why;
    return glsl::memory_refusal(bytes_needed(problem), held_bytes_, context_.free_memory_bytes());
}

void GlBackend::rewind() {
    context_.make_current();
    restore_start();
    reset_to_step_zero();
}

bool GlBackend::has_room_for(std::uint64_t bytes) const {
    const auto free = context_.free_memory_bytes();
    return !free || bytes <= *free / 2;
}

void GlBackend::reset_to_step_zero() {
    steps_ = 0;
    if (tool_.has_tool()) tool_.move(glm::dvec3(0));
    monitor_ = next_monitor_;
    if (monitor_.every == 0) return;
    if (monitor_program_.get() == 0) {
        Defines defines = glsl::formulation_defines(formulation_);
        defines.merge(divergence_defines());
        monitor_program_ = Program(context_, load_source("divergence_check.comp", defines));
        found_ = make_buffer(context_);
        glNamedBufferStorage(found_.get(), sizeof(GLuint), nullptr, GL_DYNAMIC_STORAGE_BIT);
    }
    monitor_program_.set("inverse_largest", float(1 / monitor_.largest_increment));
    glNamedBufferSubData(found_.get(), 0, sizeof(never_found), &never_found);
}

const Program& GlBackend::feed_program(Defines defines) {
    if (feed_program_.get() == 0) {
        defines.merge(glsl::formulation_defines(formulation_));
        feed_program_ = Program(context_, load_source("feed.comp", defines));
    }
    return feed_program_;
}

void GlBackend::move_tool(const glm::dvec3& displacement) {
    context_.make_current();
    tool_.move(displacement);
}

glm::dvec3 GlBackend::tool_force() {
    if (steps_ == 0) return glm::dvec3(0);
    context_.make_current();
    const glm::dvec3 force = tool_.force();
    context_.check("reading the tool's force");
    return force;
}

void GlBackend::step(int count) {
    context_.make_current();
    for (int n = 0; n < count; ++n) {
        enqueue_step();
        queue_.enqueued();
        ++steps_;
        if (monitor_.every > 0 && steps_ % monitor_.every == 0) check_divergence();
    }
}

void GlBackend::check_divergence() {
    GLint stepping = 0;
    glGetIntegerv(GL_CURRENT_PROGRAM, &stepping);
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, found_binding, found_.get());
    monitor_program_.set("check_number", int(steps_ / monitor_.every));
    glUseProgram(monitor_program_.get());
    enqueue_divergence_check();
    // What this check reads is overwritten by the next step or by an edit, and its number by the next check.
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_FRAMEBUFFER_BARRIER_BIT);
    glUseProgram(GLuint(stepping));
}

void GlBackend::measure(const StorageBuffer& squares, std::size_t count, int stride, int offset) {
    if (measure_program_.get() == 0) measure_program_ = Program(context_, load_source("measure.comp", {}));
    squares.bind(0);
    measure_program_.set("count", int(count));
    measure_program_.set("stride", stride);
    measure_program_.set("offset", offset);
    glUseProgram(measure_program_.get());
    glDispatchCompute(glsl::striding_groups(count), 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
}

void GlBackend::measure(std::span<float> squares) {
    std::vector<float> lengths(squares.begin(), squares.end());
    StorageBuffer buffer;
    buffer.upload(context_, lengths);
    measure(buffer, lengths.size(), 1, 0);
    buffer.download(lengths);
    std::copy(lengths.begin(), lengths.end(), squares.begin());
}

std::optional<Divergence> GlBackend::divergence() {
    if (monitor_.every == 0) return std::nullopt;
    context_.make_current();
    GLuint check_number = never_found;
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    glGetNamedBufferSubData(found_.get(), 0, sizeof(check_number), &check_number);
    context_.check("checking for divergence");
    if (check_number == never_found) return std::nullopt;
    const std::int64_t found = std::int64_t(check_number) * monitor_.every;
    return Divergence{found - monitor_.every, found};
}

void GlBackend::synchronize() {
    context_.make_current();
    glFinish();
    context_.check("stepping");
}

void GlBackend::mark(Mark which) {
    context_.make_current();
    glQueryCounter((which == Mark::begin ? begin_ : end_).get(), GL_TIMESTAMP);
}

double GlBackend::seconds_between_marks() const {
    context_.make_current();
    GLuint64 begin = 0;
    GLuint64 end = 0;
    glGetQueryObjectui64v(begin_.get(), GL_QUERY_RESULT, &begin);
    glGetQueryObjectui64v(end_.get(), GL_QUERY_RESULT, &end);
    return 1e-9 * double(end - begin);
}

Defines term_defines(const Problem& problem, Formulation formulation, bool all) {
    Defines defines = glsl::formulation_defines(formulation);
    defines.merge(glsl::term_constants(problem, formulation, all));
    return defines;
}

}  // namespace voxspring::gl
