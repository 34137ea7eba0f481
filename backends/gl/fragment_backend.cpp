#include "backends/gl/fragment_backend.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "backends/gl/texture.h"
#include "backends/physics/neighbours.h"

namespace voxspring::gl {
namespace {

// Texture units, as in shaders/particle.glsl.
constexpr GLuint position_unit = 0;  // x(t), then x(t - dt)
constexpr GLuint load_unit = 2;
constexpr GLuint material_unit = 3;

bool needs_loads(const Problem& problem, bool all_terms) { return all_terms || !problem.load.empty(); }
bool needs_materials(const Problem& problem, bool all_terms) { return all_terms || problem.has_materials(); }

Defines terms(const Problem& problem, bool all) {
    Defines defines;
    const auto add = [&](const char* name, bool needed) {
        if (all || needed) defines[name] = "";
    };
    add("DAMPING", problem.damping != 0);
    add("GRAVITY", problem.has_gravity());
    add("PINS", !problem.pinned.empty());
    add("LOADS", needs_loads(problem, all));
    add("MATERIALS", needs_materials(problem, all));
    add("FACES", (problem.group_bits & FACE_BITS) != 0);
    add("EDGES", (problem.group_bits & EDGE_BITS) != 0);
    add("CORNERS", (problem.group_bits & CORNER_BITS) != 0);
    return defines;
}

}  // namespace

FragmentBackend::FragmentBackend(const Options& options, std::string fragment_shader)
    : masked_(options.tuning.at("mask") == "stencil"),
      all_terms_(options.tuning.at("terms") == "all"),
      fragment_shader_(std::move(fragment_shader)),
      no_vertices_(make_vertex_array(context_)),
      begin_(make_query(context_)),
      end_(make_query(context_)) {
    glBindVertexArray(no_vertices_.get());
}

void FragmentBackend::upload(const Problem& problem, const State& state) {
    context_.make_current();
    problem_ = &problem;
    // The old textures go before the new ones come: a large problem fits once, not twice.
    frames_ = {};
    framebuffers_ = {};
    stencil_ = {};
    load_ = {};
    material_ = {};

    Layout layout = lay_out(problem);
    size_ = layout.size;
    make_frames(problem, state, layout);
    make_particle_textures(problem, layout);
    make_program(problem);
    texel_ = std::move(layout.texel);
    current_ = 1;

    glViewport(0, 0, size_.x, size_.y);
    glFinish();
    context_.check("uploading");
}

void FragmentBackend::make_frames(const Problem& problem, const State& state, const Layout& layout) {
    const auto texels = std::size_t(size_.x) * std::size_t(size_.y);
    // The third frame is all guard; its particles' texels are written before they are read.
    const float nan = std::numeric_limits<float>::quiet_NaN();
    std::vector<glm::vec4> image(texels, glm::vec4(nan, nan, nan, 0));
    frames_[2] = make_texture(context_, rgba32f, size_, image.data());
    for (const std::size_t age : {0, 1}) {
        for (std::size_t i = 0; i < layout.texel.size(); ++i) {
            glm::dvec3 position = problem.rest_position[i] + state.displacement[i];
            if (age == 1) position -= state.increment[i];
            image[layout.texel[i]] = {glm::vec3(position), std::bit_cast<float>(layout.bits[i])};
        }
        frames_[1 - age] = make_texture(context_, rgba32f, size_, image.data());
    }
    if (masked_) {
        std::vector<std::uint8_t> mask(texels, 0);
        for (const std::uint32_t texel : layout.texel) mask[texel] = 1;
        stencil_ = make_texture(context_, stencil8, size_, mask.data());
        glEnable(GL_STENCIL_TEST);
        glStencilFunc(GL_EQUAL, 1, 0xFF);
        glStencilOp(GL_KEEP, GL_KEEP, GL_KEEP);
    }
    for (std::size_t i = 0; i < frames_.size(); ++i) {
        framebuffers_[i] = make_framebuffer(context_);
        const GLuint framebuffer = framebuffers_[i].get();
        glNamedFramebufferTexture(framebuffer, GL_COLOR_ATTACHMENT0, frames_[i].get(), 0);
        if (masked_) {
            glNamedFramebufferTexture(framebuffer, GL_STENCIL_ATTACHMENT, stencil_.get(), 0);
        }
        const GLenum status = glCheckNamedFramebufferStatus(framebuffer, GL_FRAMEBUFFER);
        if (status != GL_FRAMEBUFFER_COMPLETE) {
            throw DeviceError("framebuffer incomplete: status " + std::to_string(status));
        }
    }
}

void FragmentBackend::make_particle_textures(const Problem& problem, const Layout& layout) {
    const auto texels = std::size_t(size_.x) * std::size_t(size_.y);
    if (needs_loads(problem, all_terms_)) {
        std::vector<glm::vec4> image(texels, glm::vec4(0));
        for (std::size_t i = 0; i < problem.load.size(); ++i) {
            image[layout.texel[i]] = {glm::vec3(problem.load[i]), 0};
        }
        load_ = make_texture(context_, rgba32f, size_, image.data());
        glBindTextureUnit(load_unit, load_.get());
    }
    if (needs_materials(problem, all_terms_)) {
        std::vector<glm::vec2> image(texels, glm::vec2(0));
        for (std::size_t i = 0; i < layout.texel.size(); ++i) {
            const Material& material = problem.material_of(i);
            // One material has its stiffness by group, which a compliance of 1 leaves as it is.
            const double compliance = problem.has_materials() ? 1 / material.stiffness : 1;
            image[layout.texel[i]] = {float(compliance), float(1 / material.mass)};
        }
        material_ = make_texture(context_, rg32f, size_, image.data());
        glBindTextureUnit(material_unit, material_.get());
    }
}

void FragmentBackend::make_program(const Problem& problem) {
    Defines defines = terms(problem, all_terms_);
    defines.merge(specialise(problem));
    const Source fragment = load_source(fragment_shader_, defines);
    if (fragment.text != fragment_text_) {
        program_ = Program(context_, load_source("full_screen.vert", {}), fragment);
        fragment_text_ = fragment.text;
        glUseProgram(program_.get());
    }
    program_.set("retained", float(1 - problem.damping));
    program_.set("gravity", glm::vec3(problem.gravity));
    program_.set("inverse_mass", float(1 / problem.materials[0].mass));
    program_.set("time_step_squared", float(problem.time_step * problem.time_step));
    program_.set("shortest_squared", float(problem.shortest_squared()));
    set_uniforms(program_, problem);
}

void FragmentBackend::edit(const Problem& edited, const SpringEdit& edit) {
    context_.make_current();
    problem_ = &edited;
    if (edit.empty()) return;
    if (has_room(edited, edit)) {
        write(edited_texels(edit));
        return;
    }
    // Every list anew; positions stay where they are, with new bits.
    const Layout layout = lay_out(edited);
    make_program(edited);
    TexelEdit bits;
    for (std::uint32_t i = 0; i < layout.bits.size(); ++i)
        bits.particles.push_back({texel_of(i), layout.bits[i], 0, 0});
    write(bits);
}

void FragmentBackend::write(const TexelEdit& edit) {
    const Defines defines = bind_lists();
    if (edit_program_.get() == 0 || defines != edit_defines_) {
        edit_program_ = Program(context_, load_source("edit.comp", defines));
        edit_defines_ = defines;
    }
    const auto send = [&](GLuint binding, const auto& values) {
        if (edit_buffers_[binding].get() == 0) edit_buffers_[binding] = make_buffer(context_);
        const GLuint buffer = edit_buffers_[binding].get();
        // One element at least: an empty buffer cannot be bound.
        const std::size_t bytes = std::max<std::size_t>(values.size(), 1) * sizeof(values[0]);
        glNamedBufferData(buffer, GLsizeiptr(bytes), nullptr, GL_STREAM_DRAW);
        glNamedBufferSubData(buffer, 0, GLsizeiptr(values.size() * sizeof(values[0])), values.data());
        glBindBufferBase(GL_SHADER_STORAGE_BUFFER, binding, buffer);
    };
    send(0, edit.particles);
    send(1, edit.neighbour);
    send(2, edit.spring);
    // A step copies w from the frame that it reads, so that the bits of that one are enough.
    glBindImageTexture(0, frames_[frame(0)].get(), 0, GL_FALSE, 0, GL_READ_WRITE, rgba32f.internal);
    edit_program_.set("particle_count", int(edit.particles.size()));
    glUseProgram(edit_program_.get());
    constexpr std::size_t group = 64, most_groups = 65535;
    glDispatchCompute(GLuint(std::min((edit.particles.size() + group - 1) / group, most_groups)), 1, 1);
    glMemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_FRAMEBUFFER_BARRIER_BIT |
                    GL_TEXTURE_UPDATE_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT);
    glUseProgram(program_.get());
}

void FragmentBackend::step(int count) {
    context_.make_current();
    for (int n = 0; n < count; ++n) {
        const GLuint sources[] = {frames_[frame(0)].get(), frames_[frame(1)].get()};
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffers_[frame(2)].get());
        glBindTextures(position_unit, 2, sources);
        glDrawArrays(GL_TRIANGLES, 0, 3);
        current_ = frame(2);
    }
}

void FragmentBackend::synchronize() {
    context_.make_current();
    glFinish();
    context_.check("stepping");
}

State FragmentBackend::download() {
    const std::vector<glm::vec4> now = texels(0);
    const std::vector<glm::vec4> before = texels(1);
    State state = state_at_rest(*problem_);
    for (std::size_t i = 0; i < texel_.size(); ++i) {
        const glm::dvec3 position(now[texel_[i]]);
        state.displacement[i] = position - problem_->rest_position[i];
        state.increment[i] = position - glm::dvec3(before[texel_[i]]);
    }
    return state;
}

std::vector<glm::vec4> FragmentBackend::texels(int age) {
    synchronize();
    std::vector<glm::vec4> image(std::size_t(size_.x) * std::size_t(size_.y));
    glGetTextureImage(frames_[frame(age)].get(), 0, rgba32f.external, rgba32f.type,
                      GLsizei(image.size() * sizeof(glm::vec4)), image.data());
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

std::map<std::string, TuningValues> fragment_tuning() {
    return {{"mask", {"stencil", "none"}}, {"terms", {"needed", "all"}}};
}

std::uint64_t fragment_bytes(const Problem& problem, const Options& options, std::uint64_t texels) {
    const bool all = options.tuning.at("terms") == "all";
    int bytes = 3 * rgba32f.bytes;
    if (options.tuning.at("mask") == "stencil") bytes += stencil8.bytes;
    if (needs_loads(problem, all)) bytes += rgba32f.bytes;
    if (needs_materials(problem, all)) bytes += rg32f.bytes;
    return texels * std::uint64_t(bytes);
}

}  // namespace voxspring::gl
