#include "backends/gl/compute_backend.h"

#include <fmt/format.h>

#include <chrono>
#include <numeric>
#include <utility>

#include "backends/gl/feed_pass.h"
#include "backends/gl/limits.h"
#include "backends/gl/texture.h"
#include "backends/layout/feed.h"

namespace voxspring::gl {
namespace {

using glsl::increments, glsl::increments_low, glsl::inverse_masses, glsl::loads, glsl::words, glsl::words_low;

}  // namespace

ComputeBackend::ComputeBackend(const Options& options, std::string shader)
    : GlBackend(options),
      shader_(std::move(shader)),
      through_textures_(options.tuning.at("fetch") == "texture"),
      barrier_(GL_SHADER_STORAGE_BARRIER_BIT | (through_textures_ ? GL_TEXTURE_FETCH_BARRIER_BIT : 0U)) {
    GLint max_blocks = 0;
    glGetIntegerv(GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS, &max_blocks);
    if (max_blocks < glsl::storage_blocks)
        throw Unavailable("a compute shader may have " + std::to_string(max_blocks) +
                          " storage buffers, not " + std::to_string(glsl::storage_blocks));
}

Capabilities ComputeBackend::capabilities() const {
    Capabilities capabilities = context().capabilities();
    capabilities.api = "OpenGL compute 4.5 core";
    capabilities.limits_of = "OpenGL compute";
    return capabilities;
}

std::string ComputeBackend::too_large(const char* what, std::uint64_t bytes) const {
    const auto max_bytes = std::uint64_t(context().max_storage_block_size());
    if (bytes <= max_bytes) return {};
    return fmt::format("{} of {} bytes exceed the {} that the driver allows one storage buffer", what, bytes,
                       max_bytes);
}

std::string ComputeBackend::refused(const Problem& problem) const {
    if (std::string why = refused_layout(problem); !why.empty()) return why;
    const layout::Placement placement = place(problem);
    if (std::string why = too_large("positions", placement.words * sizeof(layout::ParticleRecord<float>));
        !why.empty())
        return why;
    const auto texels = std::uint64_t(context().max_texture_buffer_size());
    if (through_textures_ && placement.words > texels)
        return std::to_string(placement.words) + " texels of positions exceed the " + std::to_string(texels) +
               " that the driver allows one texture buffer";
    return {};
}

void ComputeBackend::upload(const Problem& problem, const State& state) {
    context().make_current();
    problem_ = &problem;
    compile_seconds_ = 0;
    start_ = {};
    layout_ = lay_out(problem);
    const layout::Placement& placement = layout_.placement;
    {
        const layout::PackedState<float> packed =
            layout::pack<float>(problem, state, placement, layout_.bits, formulation());
        current_ = 0;
        const bool split = formulation() == Formulation::compensated;
        words_[0].upload(context(), packed.current);
        // By increments a step writes every particle's word to this buffer before any step reads it.
        words_[1].upload(context(), by_increments(formulation()) ? packed.current : packed.previous);
        for (StorageBuffer& low : low_) low.upload(context(), packed.current_low);
        increment_.upload(context(), packed.increment);
        increment_low_.upload(context(), packed.increment_low);
        for (std::size_t i = 0; through_textures_ && i < 2; ++i) {
            word_texture_[i] = make_buffer_texture(context(), rgba32f, words_[i].get());
            if (split) low_texture_[i] = make_buffer_texture(context(), rgba32f, low_[i].get());
        }
    }
    const auto operands = glsl::pack_operands<float>(problem, placement, all_terms());
    load_.upload(context(), operands.loads);
    inverse_mass_.upload(context(), operands.inverse_masses);
    make_program(problem);
    tool_pass().make(context(), problem, placement, formulation(), {});
    reset_to_step_zero();
    bind();
    hold(bytes_needed(problem));
    glFinish();
    context().check("uploading");
}

bool ComputeBackend::keep_start() {
    context().make_current();
    const auto buffers = state_buffers();
    std::uint64_t bytes = 0;
    for (const StorageBuffer* const buffer : buffers) bytes += buffer->bytes();
    if (!has_room_for(bytes)) return false;
    for (std::size_t n = 0; n < buffers.size(); ++n) start_[n].copy(context(), *buffers[n]);
    context().check("keeping the start");
    return true;
}

void ComputeBackend::restore_start() {
    // Makes what shaders wrote visible to the copies of other commands.
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    const auto buffers = state_buffers();
    for (std::size_t n = 0; n < buffers.size(); ++n) buffers[n]->copy(context(), start_[n]);
    glMemoryBarrier(barrier_);
    current_ = 0;
}

void ComputeBackend::make_program(const Problem& problem) {
    Defines defines = term_defines(problem, formulation(), all_terms());
    defines.merge(specialise(problem));
    if (through_textures_) defines["TEXTURE"] = "";
    const Source source = load_source(shader_, defines);
    const auto known = programs_.find(source.text);
    if (known == programs_.end()) {
        constexpr std::size_t max_programs = 16;
        if (programs_.size() == max_programs) programs_.clear();
        const auto begin = std::chrono::steady_clock::now();
        program_ = &(programs_[source.text] = Program(context(), source));
        compile_seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    } else {
        program_ = &known->second;
    }
    glsl::set_motion<float>(*program_, problem);
    program_->set("pitch", int(layout::increment_pitch(layout_.placement)));
    set_uniforms(*program_, problem);
}

void ComputeBackend::bind() const {
    glUseProgram(program_->get());
    increment_.bind(increments);
    increment_low_.bind(increments_low);
    load_.bind(loads);
    inverse_mass_.bind(inverse_masses);
    bind_own();
}

void ComputeBackend::bind_words() const {
    const std::size_t next = 1 - current_;
    if (through_textures_) {
        const std::array textures = {word_texture_[current_].get(), low_texture_[current_].get()};
        glBindTextures(0, GLsizei(textures.size()), textures.data());
    }
    const std::array buffers = {words_[current_].get(), words_[next].get()};
    glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, words, GLsizei(buffers.size()), buffers.data());
    if (formulation() != Formulation::compensated) return;
    const std::array low = {low_[current_].get(), low_[next].get()};
    glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, words_low, GLsizei(low.size()), low.data());
}

void ComputeBackend::enqueue_step() {
    bind_words();
    if (tool_pass().has_tool()) {
        tool_pass().dispatch();
        glMemoryBarrier(barrier_);
        glUseProgram(program_->get());
    }
    glDispatchCompute(GLuint(layout_.groups.x), GLuint(layout_.groups.y), GLuint(layout_.groups.z));
    glMemoryBarrier(barrier_);
    current_ = 1 - current_;
}

void ComputeBackend::enqueue_divergence_check() {
    const std::array buffers = {words_[current_].get(), words_[1 - current_].get()};
    glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, words, GLsizei(buffers.size()), buffers.data());
    glDispatchCompute(glsl::striding_groups(layout_.placement.words), 1, 1);
}

State ComputeBackend::download() {
    synchronize();
    layout::PackedState<float> packed;
    const auto out = [&]<class T>(std::vector<T>& values, const StorageBuffer& buffer) {
        values.resize(buffer.bytes() / sizeof(T));
        buffer.download(values);
    };
    out(packed.current, words_[current_]);
    if (!by_increments(formulation())) out(packed.previous, words_[1 - current_]);
    out(packed.current_low, low_[current_]);
    out(packed.increment, increment_);
    out(packed.increment_low, increment_low_);
    context().check("downloading");
    return layout::unpack<float>(*problem_, packed, layout_.placement, formulation());
}

std::unique_ptr<Feed> ComputeBackend::feed(const std::vector<std::uint32_t>& particles,
                                           std::uint32_t buffer) {
    if (!context().shares()) return nullptr;
    context().make_current();
    const auto fed = layout::pack_fed<float>(*problem_, particles, formulation(),
                                             [&](std::uint32_t i) { return layout_.placement.at(i); });
    return std::make_unique<FeedPass>(context(), fed, buffer, feed_program({}), [this] { bind_words(); });
}

void ComputeBackend::set_problem(const Problem& edited) {
    context().make_current();
    problem_ = &edited;
}

void ComputeBackend::lay_out_anew() {
    layout_ = lay_out(*problem_);
    make_program(*problem_);
    bind();
    std::vector<std::uint32_t> all(problem_->particle_count());
    std::iota(all.begin(), all.end(), 0U);
    write_bits(all, layout_.bits);
}

void ComputeBackend::dispatch_edit(const Program& program, std::size_t count) {
    glUseProgram(program.get());
    // The barrier after the last step keeps the edit from overtaking that step; the barrier after the edit
    // keeps the next step from overtaking the edit.
    glDispatchCompute(glsl::striding_groups(count), 1, 1);
    glMemoryBarrier(barrier_);
    bind();
}

void ComputeBackend::write_bits(std::span<const std::uint32_t> particles,
                                std::span<const std::uint32_t> bits) {
    if (particles.empty()) return;
    if (bits_program_.get() == 0) bits_program_ = Program(context(), load_source("edit_bits.comp", {}));
    std::vector<std::uint32_t> edited;
    edited.reserve(2 * particles.size());
    for (std::size_t n = 0; n < particles.size(); ++n) {
        edited.push_back(std::uint32_t(layout_.placement.at(particles[n])));
        edited.push_back(bits[n]);
    }
    edited_.replace(context(), edited);
    words_[current_].bind(0);
    edited_.bind(1);
    bits_program_.set("count", int(particles.size()));
    dispatch_edit(bits_program_, particles.size());
}

WorkCount ComputeBackend::count_work() {
    context().make_current();
    const glm::ivec3 g = layout_.groups;
    WorkCount work{{"work_groups", std::uint64_t(g.x) * std::uint64_t(g.y) * std::uint64_t(g.z)}};
    if (!context().has_pipeline_statistics()) {
        step(1);
        return work;
    }
    const Query query = make_query(context());
    glBeginQuery(GL_COMPUTE_SHADER_INVOCATIONS_ARB, query.get());
    step(1);
    glEndQuery(GL_COMPUTE_SHADER_INVOCATIONS_ARB);
    GLuint64 invocations = 0;
    glGetQueryObjectui64v(query.get(), GL_QUERY_RESULT, &invocations);
    work["compute_shader_invocations"] = invocations;
    context().check("counting work");
    return work;
}

DeviceLimits ComputeBackend::measure_limits() {
    context().make_current();
    return measure_compute_limits(context());
}

std::optional<double> ComputeBackend::own_launch_seconds() {
    context().make_current();
    return measure_dispatch(context());
}

}  // namespace voxspring::gl
