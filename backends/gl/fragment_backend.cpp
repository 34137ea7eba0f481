#include "backends/gl/fragment_backend.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "backends/gl/feed_pass.h"
#include "backends/gl/limits.h"
#include "backends/gl/texture.h"
#include "backends/glsl/compute.h"
#include "backends/layout/particles.h"
#include "backends/layout/state_hash.h"
#include "backends/layout/work.h"
#include "backends/physics/huge_pages.h"
#include "backends/physics/neighbours.h"

namespace voxspring::gl {
namespace {

// Texture units, as in shaders/particle.glsl.
constexpr GLuint state_unit = 0;  // the first of up to four
constexpr GLuint load_unit = 4;
constexpr GLuint material_unit = 5;

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
/// The content of a texel without a particle.
const glm::vec4 guard(nan, nan, nan, 0);

std::size_t target_count_of(Formulation formulation) {
    if (formulation == Formulation::compensated) return 4;
    return by_increments(formulation) ? 2 : 1;
}
std::size_t frame_count_of(Formulation formulation) { return by_increments(formulation) ? 2 : 3; }

/// The vector of a particle's texel in target `target` of the frame for time t - age dt.
glm::vec3 stored(Formulation formulation, const Problem& problem, const State& state, std::size_t particle,
                 std::size_t age, std::size_t target) {
    if (by_increments(formulation)) {
        const glm::dvec3 exact =
            target % 2 == 0 ? state.displacement_of(particle) : state.increment_of(particle);
        const glm::vec3 high(exact);
        return target < 2 ? high : glm::vec3(exact - glm::dvec3(high));
    }
    glm::dvec3 place = state.displacement_of(particle);
    if (on_positions(formulation)) place += problem.rest_position[particle];
    if (age == 1) place -= state.increment_of(particle);
    return glm::vec3(place);
}

/// Operations on vectors in one step of a particle, after its forces are summed.
std::uint64_t motion_operations(Formulation formulation, bool gravity, bool damping) {
    // paper_position() and next_position() take seven operations each. One of these is for gravity and one
    // for damping.
    if (!by_increments(formulation)) return 5U + (gravity ? 1 : 0) + (damping ? 1 : 0);
    const std::uint64_t change = 2U + (gravity ? 1 : 0) + (damping ? 2 : 0);
    // Two sums, each of one operation. In `compensated` a sum is a split_high() with a split_low(), which
    // take 11 operations, or 10 if no low part is added.
    return change + (formulation == Formulation::compensated ? 10 + 11 : 2);
}

/// The value of found_ until a check fails. Then found_ is the number, from 1, of that first failed check.
constexpr GLuint never_found = std::numeric_limits<GLuint>::max();
constexpr GLuint found_binding = 3;  // as in shaders/divergence_check.comp

}  // namespace

FragmentBackend::FragmentBackend(const Options& options, std::string fragment_shader)
    : options_(options),
      queue_(context_),
      begin_(make_query(context_)),
      end_(make_query(context_)),
      masked_(options.tuning.at("mask") == "stencil"),
      fragment_shader_(std::move(fragment_shader)),
      no_vertices_(make_vertex_array(context_)) {
    glBindVertexArray(no_vertices_.get());
}

void FragmentBackend::upload(const Problem& problem, const State& state) {
    context_.make_current();
    problem_ = &problem;
    // Frees the old textures before the new ones are made, because memory may have room for only one set of
    // them.
    frames_.clear();
    start_.clear();
    stencil_ = {};
    load_ = {};
    material_ = {};

    Layout layout = lay_out(problem);
    size_ = layout.size;
    make_frames(problem, state, layout);
    make_particle_textures(problem, layout);
    make_program(problem);
    texel_ = std::move(layout.texel);
    make_tool(problem);
    reset_to_step_zero();

    glViewport(0, 0, size_.x, size_.y);
    held_bytes_ = bytes_needed(problem);
    glFinish();
    context_.check("uploading");
}

void FragmentBackend::make_tool(const Problem& problem) {
    // The list has an element for every particle, but only the texels of held particles are filled in.
    std::vector<std::uint32_t> texels(problem.has_tool() ? problem.particle_count() : 0);
    for (const std::uint32_t held : problem.tool.particles) texels[held] = texel_of(held);
    const auto held =
        layout::pack_held<float>(problem, {.words = texels.size(), .voxel = &texels}, formulation());
    held_.upload(context_, held);
    held_forces_.upload(context_, std::vector<layout::HeldForce<float>>(held.size()));
    if (held.empty()) return;
    if (tool_program_.get() == 0) {
        Defines defines = glsl::formulation_defines(formulation());
        defines["TEXELS"] = "";
        tool_program_ = Program(context_, load_source("tool.comp", defines));
    }
    tool_program_.set("count", int(held.size()));
    tool_program_.set("stiffness", float(problem.tool.stiffness));
}

void FragmentBackend::make_frames(const Problem& problem, const State& state, const Layout& layout) {
    if (masked_) make_stencil(layout);
    frames_.resize(frame_count_of(formulation()));
    // The last frame has guard values in all texels. Steps write its particles' texels before they read them.
    current_ = start_frames() - 1;
    std::vector<glm::vec4> image(std::size_t(size_.x) * std::size_t(size_.y), guard);
    for (std::size_t f = frames_.size(); f-- > 0;) {
        Frame& frame = frames_[f];
        frame.framebuffer = make_framebuffer(context_);
        const GLuint framebuffer = frame.framebuffer.get();
        std::vector<GLenum> attachments;
        for (std::size_t target = 0; target < target_count_of(formulation()); ++target) {
            const auto filled = f <= current_ ? std::ptrdiff_t(layout.texel.size()) : 0;
#pragma omp parallel for
            for (std::ptrdiff_t n = 0; n < filled; ++n) {
                const auto i = std::size_t(n);
                const float w = target == 0 ? std::bit_cast<float>(layout.bits[i]) : 0;
                image[layout.texel[i]] = {stored(formulation(), problem, state, i, current_ - f, target), w};
            }
            frame.targets.push_back(make_texture(context_, rgba32f, size_, image.data()));
            attachments.push_back(GLenum(GL_COLOR_ATTACHMENT0 + target));
            glNamedFramebufferTexture(framebuffer, attachments.back(), frame.targets.back().get(), 0);
        }
        glNamedFramebufferDrawBuffers(framebuffer, GLsizei(attachments.size()), attachments.data());
        if (masked_) {
            glNamedFramebufferTexture(framebuffer, GL_STENCIL_ATTACHMENT, stencil_.get(), 0);
        }
        const GLenum status = glCheckNamedFramebufferStatus(framebuffer, GL_FRAMEBUFFER);
        if (status != GL_FRAMEBUFFER_COMPLETE) {
            throw DeviceError("framebuffer incomplete: status " + std::to_string(status));
        }
    }
}

bool FragmentBackend::keep_start() {
    context_.make_current();
    start_.clear();
    const std::uint64_t texels = std::uint64_t(size_.x) * std::uint64_t(size_.y);
    const std::uint64_t bytes = texels * start_frames() * target_count() * std::uint64_t(rgba32f.bytes);
    const auto free = context_.free_memory_bytes();
    if (free && bytes > *free / 2) return false;  // half of the free memory is left to other programs
    for (std::size_t f = 0; f < start_frames(); ++f) {
        for (const Texture& target : frames_[f].targets) {
            start_.push_back(make_texture(context_, rgba32f, size_, nullptr));
            copy_texture(target, start_.back(), size_);
        }
    }
    context_.check("copying the state at step 0");
    return true;
}

void FragmentBackend::make_stencil(const Layout& layout) {
    std::vector<std::uint8_t> mask(std::size_t(size_.x) * std::size_t(size_.y), 0);
    for (const std::uint32_t texel : layout.texel) mask[texel] = 1;
    stencil_ = make_texture(context_, stencil8, size_, mask.data());
    glEnable(GL_STENCIL_TEST);
    glStencilFunc(GL_EQUAL, 1, 0xFF);
    glStencilOp(GL_KEEP, GL_KEEP, GL_KEEP);
}

void FragmentBackend::make_particle_textures(const Problem& problem, const Layout& layout) {
    const auto texels = std::size_t(size_.x) * std::size_t(size_.y);
    if (glsl::needs_loads(problem, all_terms())) {
        std::vector<glm::vec4> image(texels, glm::vec4(0));
        for (std::size_t i = 0; i < problem.load.size(); ++i) {
            image[layout.texel[i]] = {glm::vec3(problem.load[i]), 0};
        }
        load_ = make_texture(context_, rgba32f, size_, image.data());
        glBindTextureUnit(load_unit, load_.get());
    }
    if (glsl::needs_materials(problem, all_terms())) {
        std::vector<glm::vec2> image(texels, glm::vec2(0));
        for (std::size_t i = 0; i < layout.texel.size(); ++i) {
            const Material& material = problem.material_of(i);
            // With one material the shader multiplies by the stiffness of each group, which compliances of 1
            // leave as it is.
            const double compliance = problem.has_materials() ? 1 / material.stiffness : 1;
            image[layout.texel[i]] = {float(compliance), float(1 / material.mass)};
        }
        material_ = make_texture(context_, rg32f, size_, image.data());
        glBindTextureUnit(material_unit, material_.get());
    }
}

void FragmentBackend::make_program(const Problem& problem) {
    Defines defines = glsl::formulation_defines(formulation());
    defines.merge(glsl::term_constants(problem, formulation(), all_terms()));
    defines.merge(specialise(problem));
    const Source fragment = load_source(fragment_shader_, defines);
    if (fragment.text != fragment_text_) {
        program_ = Program(context_, load_source("full_screen.vert", {}), fragment);
        fragment_text_ = fragment.text;
    }
    std::array<float, neighbour_count / 2> deficit{};
    for (const Direction& direction : directions())
        deficit[std::size_t(direction.bit / 2)] = float(rest_spring(problem, direction).deficit);
    program_.set("rest_deficit", deficit);
    glsl::set_motion<float>(program_, problem);
    set_uniforms(program_, problem);
    glUseProgram(program_.get());
}

void FragmentBackend::edit(const Problem& edited, const SpringEdit& edit) {
    context_.make_current();
    problem_ = &edited;
    if (edit.empty()) return;
    if (has_room(edited, edit)) {
        write(edited_texels(edited, edit));
        return;
    }
    // All lists are made anew. Particles keep their texels, which get new bits.
    const Layout layout = lay_out(edited);
    make_program(edited);
    TexelEdit bits;
    for (std::uint32_t i = 0; i < layout.bits.size(); ++i)
        bits.particles.push_back({texel_of(i), layout.bits[i], 0, 0});
    write(bits);
    held_bytes_ = bytes_needed(edited);
}

void FragmentBackend::write(const TexelEdit& edit) {
    const Defines defines = bind_lists();
    if (edit_program_.get() == 0 || defines != edit_defines_) {
        edit_program_ = Program(context_, load_source("edit.comp", defines));
        edit_defines_ = defines;
    }
    const auto send = [&](GLuint binding, const auto& values) {
        edit_buffers_[binding].replace(context_, values);
        edit_buffers_[binding].bind(binding);
    };
    send(0, edit.particles);
    send(1, edit.neighbour);
    send(2, edit.spring);
    send(3, edit.off_lattice_rest);
    // A step copies w, the bits, from the frame that it reads. So it is enough to write the bits of that
    // frame.
    glBindImageTexture(0, frame(0).targets[0].get(), 0, GL_FALSE, 0, GL_READ_WRITE, rgba32f.internal);
    edit_program_.set("particle_count", int(edit.particles.size()));
    glUseProgram(edit_program_.get());
    // Image stores may overtake the texture fetches of earlier steps. This barrier makes the stores wait for
    // the fetches.
    glMemoryBarrier(GL_SHADER_IMAGE_ACCESS_BARRIER_BIT);
    glDispatchCompute(glsl::striding_groups(edit.particles.size()), 1, 1);
    glMemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_FRAMEBUFFER_BARRIER_BIT |
                    GL_TEXTURE_UPDATE_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT);
    glUseProgram(program_.get());
}

std::string FragmentBackend::unsupported(const Problem& problem) const {
    context_.make_current();
    if (std::string why = Backend::unsupported(problem); !why.empty()) return why;
    if (std::string why = refused(problem); !why.empty()) return why;
    return glsl::memory_refusal(bytes_needed(problem), held_bytes_, context_.free_memory_bytes());
}

void FragmentBackend::rewind() {
    context_.make_current();
    auto kept = start_.begin();
    for (std::size_t f = 0; f < start_frames(); ++f) {
        for (const Texture& target : frames_[f].targets) copy_texture(*kept++, target, size_);
    }
    current_ = start_frames() - 1;
    reset_to_step_zero();
}

void FragmentBackend::reset_to_step_zero() {
    steps_ = 0;
    if (held_.bytes() > 0) move_tool(glm::dvec3(0));
    monitor_ = next_monitor_;
    if (monitor_.every == 0) return;
    if (monitor_program_.get() == 0) {
        monitor_program_ =
            Program(context_, load_source("divergence_check.comp", glsl::formulation_defines(formulation())));
        found_ = make_buffer(context_);
        glNamedBufferStorage(found_.get(), sizeof(GLuint), nullptr, GL_DYNAMIC_STORAGE_BIT);
    }
    monitor_program_.set("inverse_largest", float(glsl::inverse_largest(monitor_.largest_increment)));
    // A check before this may still run, and NVIDIA's driver lets copies overtake dispatches
    // (StorageBuffer::upload()).
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    glFinish();
    glNamedBufferSubData(found_.get(), 0, sizeof(never_found), &never_found);
}

void FragmentBackend::move_tool(const glm::dvec3& displacement) {
    context_.make_current();
    tool_program_.set("moved", glm::vec3(displacement));
}

glm::dvec3 FragmentBackend::tool_force() {
    if (steps_ == 0) return glm::dvec3(0);
    context_.make_current();
    std::vector<layout::HeldForce<float>> forces(problem_->tool.particles.size());
    held_forces_.download(forces);
    context_.check("reading the tool's force");
    return layout::force_on_tool(forces);
}

void FragmentBackend::step(int count) {
    context_.make_current();
    for (int n = 0; n < count; ++n) {
        enqueue_step();
        queue_.enqueued();
        ++steps_;
        if (monitor_.every > 0 && steps_ % monitor_.every == 0) check_divergence();
    }
}

void FragmentBackend::check_divergence() {
    constexpr int group = 64;  // as in shaders/divergence_check.comp
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, found_binding, found_.get());
    monitor_program_.set("check_number", int(steps_ / monitor_.every));
    glUseProgram(monitor_program_.get());
    bind_state();
    glDispatchCompute(GLuint((size_.x + group - 1) / group), GLuint(size_.y), 1);
    // The barrier is needed because a later step or edit overwrites what this check reads, and the next check
    // reads found_.
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_FRAMEBUFFER_BARRIER_BIT);
    glUseProgram(program_.get());
}

void FragmentBackend::measure(std::span<float> squares) {
    if (measure_program_.get() == 0) measure_program_ = Program(context_, load_source("measure.comp", {}));
    StorageBuffer buffer;
    buffer.upload(context_, std::as_bytes(squares));
    buffer.bind(0);
    measure_program_.set("count", int(squares.size()));
    measure_program_.set("stride", 1);
    measure_program_.set("offset", 0);
    glUseProgram(measure_program_.get());
    glDispatchCompute(glsl::striding_groups(squares.size()), 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
    buffer.download(std::as_writable_bytes(squares));
}

std::optional<Divergence> FragmentBackend::divergence() {
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

void FragmentBackend::synchronize() {
    context_.make_current();
    glFinish();
    context_.check("stepping");
}

void FragmentBackend::mark(Mark which) {
    context_.make_current();
    glQueryCounter((which == Mark::begin ? begin_ : end_).get(), GL_TIMESTAMP);
}

double FragmentBackend::seconds_between_marks() const {
    context_.make_current();
    GLuint64 begin = 0;
    GLuint64 end = 0;
    glGetQueryObjectui64v(begin_.get(), GL_QUERY_RESULT, &begin);
    glGetQueryObjectui64v(end_.get(), GL_QUERY_RESULT, &end);
    return 1e-9 * double(end - begin);
}

void FragmentBackend::enqueue_step() {
    bind_state();
    if (held_.bytes() > 0) enqueue_tool();
    current_ = (current_ + 1) % frames_.size();
    glBindFramebuffer(GL_FRAMEBUFFER, frame(0).framebuffer.get());
    glDrawArrays(GL_TRIANGLES, 0, 3);
}

void FragmentBackend::enqueue_tool() const {
    glBindImageTexture(0, load_.get(), 0, GL_FALSE, 0, GL_WRITE_ONLY, rgba32f.internal);
    // Image stores may overtake the texture fetches of the step before. This barrier makes them wait.
    glMemoryBarrier(GL_SHADER_IMAGE_ACCESS_BARRIER_BIT);
    held_.bind(glsl::held_words);
    held_forces_.bind(glsl::held_forces);
    glUseProgram(tool_program_.get());
    glDispatchCompute(glsl::striding_groups(problem_->tool.particles.size()), 1, 1);
    glMemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_SHADER_STORAGE_BARRIER_BIT);
    glUseProgram(program_.get());
}

FragmentBackend::StateTextures FragmentBackend::state_textures() const {
    StateTextures textures;
    if (by_increments(formulation())) {
        for (const Texture& target : frame(0).targets) textures.name[textures.count++] = target.get();
    } else {
        for (const std::size_t age : {0, 1}) textures.name[textures.count++] = frame(age).targets[0].get();
    }
    return textures;
}

void FragmentBackend::bind_state() const {
    const StateTextures textures = state_textures();
    glBindTextures(state_unit, GLsizei(textures.count), textures.name.data());
}

std::unique_ptr<Feed> FragmentBackend::feed(const std::vector<std::uint32_t>& particles,
                                            std::uint32_t buffer) {
    if (!context_.shares()) return nullptr;
    context_.make_current();
    const auto fed = layout::pack_fed<float>(*problem_, particles, formulation(),
                                             [&](std::uint32_t i) { return texel_of(i); });
    if (feed_program_.get() == 0) {
        Defines defines = glsl::formulation_defines(formulation());
        defines["TEXELS"] = "";
        feed_program_ = Program(context_, load_source("feed.comp", defines));
    }
    return std::make_unique<FeedPass>(context_, fed, buffer, feed_program_, [this] { bind_state(); });
}

std::string FragmentBackend::state_fingerprint() {
    context_.make_current();
    if (hash_program_.get() == 0) hash_program_ = Program(context_, load_source("hash.comp", {}));
    layout::HashSums hash{};
    StorageBuffer sums;
    sums.upload(context_, std::as_bytes(std::span(hash)));
    sums.bind(1);
    const std::size_t count = std::size_t(size_.x) * std::size_t(size_.y) * 4;  // components of texels
    glUseProgram(hash_program_.get());
    hash_program_.set("count", int(count));
    const StateTextures textures = state_textures();
    for (std::size_t number = 0; number < textures.count; ++number) {
        hash_program_.set("array_number", int(number));
        glBindTextureUnit(state_unit, textures.name[number]);
        glDispatchCompute(glsl::striding_groups(count), 1, 1);
        glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
    }
    glUseProgram(program_.get());
    sums.download(std::as_writable_bytes(std::span(hash)));
    context_.check("hashing the state");
    return layout::text_of(hash);
}

State FragmentBackend::download() {
    const bool increments = by_increments(formulation());
    const std::vector<glm::vec4> now = texels(0);
    const std::vector<glm::vec4> other = increments ? texels(0, 1) : texels(1);
    State state = state_at_rest(*problem_);
    const auto particles = std::ptrdiff_t(texel_.size());
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < particles; ++n) {
        const auto i = std::size_t(n);
        const glm::dvec3 place(now[texel_[i]]);
        const glm::dvec3 motion(other[texel_[i]]);
        state.displacement[i] = on_positions(formulation()) ? place - problem_->rest_position[i] : place;
        state.increment[i] = increments ? motion : place - motion;
    }
    if (formulation() == Formulation::compensated) {
        const std::vector<glm::vec4> low = texels(0, 2);
        const std::vector<glm::vec4> motion_low = texels(0, 3);
#pragma omp parallel for
        for (std::ptrdiff_t n = 0; n < particles; ++n) {
            const auto i = std::size_t(n);
            state.displacement[i] += glm::dvec3(low[texel_[i]]);
            state.increment[i] += glm::dvec3(motion_low[texel_[i]]);
        }
    }
    return state;
}

std::vector<glm::vec4> FragmentBackend::texels(std::size_t age, std::size_t target) {
    synchronize();
    std::vector<glm::vec4> image;
    resize_in_huge_pages(image, std::size_t(size_.x) * std::size_t(size_.y));
    read_texture(frame(age).targets[target], rgba32f, size_, image.data(), rows_of_a_read(rgba32f, size_.x));
    context_.check("downloading");
    return image;
}

WorkCount FragmentBackend::count_work() {
    context_.make_current();
    struct Counter {
        const char* name;
        GLenum target;
        Query query;
    };
    std::vector<Counter> counters;
    const auto add = [&](const char* name, GLenum target) {
        counters.push_back({name, target, make_query(context_)});
    };
    add("samples_passed", GL_SAMPLES_PASSED);
    if (context_.has_pipeline_statistics()) {
        add("fragment_shader_invocations", GL_FRAGMENT_SHADER_INVOCATIONS_ARB);
    }
    for (const Counter& counter : counters) glBeginQuery(counter.target, counter.query.get());
    step(1);
    for (const Counter& counter : counters) glEndQuery(counter.target);
    WorkCount work;
    for (const Counter& counter : counters) {
        GLuint64 value = 0;
        glGetQueryObjectui64v(counter.query.get(), GL_QUERY_RESULT, &value);
        work[counter.name] = value;
    }
    context_.check("counting work");
    return work;
}

DeviceLimits FragmentBackend::measure_limits() {
    context_.make_current();
    return gl::measure_limits(context_);
}

std::optional<double> FragmentBackend::own_launch_seconds() {
    context_.make_current();
    return measure_draw(context_);
}

StepWork FragmentBackend::fragment_work(const Problem& problem, std::uint64_t unmasked) const {
    const std::uint64_t particles = problem.particle_count();
    const bool loads = glsl::needs_loads(problem, all_terms());
    const bool materials = glsl::needs_materials(problem, all_terms());
    const std::uint64_t vectors = motion_operations(formulation(), all_terms() || problem.has_gravity(),
                                                    all_terms() || problem.damping != 0) +
                                  (loads ? 1 : 0);
    // With one target per frame a step reads two frames and writes one. With several targets it reads one
    // frame and writes one. In both cases it moves each frame once.
    const std::uint64_t frame =
        (masked_ ? particles : unmasked) * target_count_of(formulation()) * std::uint64_t(rgba32f.bytes);
    const std::uint64_t all =
        frame_count_of(formulation()) * frame +
        particles * std::uint64_t((loads ? rgba32f.bytes : 0) + (materials ? rg32f.bytes : 0));
    return {
        .bytes = all,
        .written_bytes = frame,
        .footprint_bytes = all,
        .operations = particles * 3 * vectors + 2 * (layout::pull_operations<float>(problem, formulation()) +
                                                     // 3 per spring end to add the force
                                                     3 * count_springs(problem).total())};
}

std::map<std::string, TuningValues> fragment_tuning() {
    return {{"mask", {"stencil", "none"}}, {"terms", {"needed", "all"}}};
}

std::uint64_t fragment_bytes(const Problem& problem, const Options& options, std::uint64_t texels) {
    const bool all = options.tuning.at("terms") == "all";
    const std::size_t targets = frame_count_of(options.formulation) * target_count_of(options.formulation);
    int bytes = int(targets) * rgba32f.bytes;
    if (options.tuning.at("mask") == "stencil") bytes += stencil8.bytes;
    if (glsl::needs_loads(problem, all)) bytes += rgba32f.bytes;
    if (glsl::needs_materials(problem, all)) bytes += rg32f.bytes;
    return texels * std::uint64_t(bytes);
}

}  // namespace voxspring::gl
