// What the backends share that step by compute shaders: the state in storage buffers, one dispatch per step
// and the barrier after it, and edits of particles' bits (README.md).
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "backends/gl/gl_backend.h"
#include "backends/gl/storage_buffer.h"
#include "backends/glsl/compute.h"
#include "backends/layout/particles.h"

namespace voxspring::gl {

class ComputeBackend : public GlBackend {
public:
    Capabilities capabilities() const final;
    void upload(const Problem& problem, const State& state) final;
    bool keep_start() final;
    State download() final;
    std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& particles, std::uint32_t buffer) final;
    /// "work_groups", and "compute_shader_invocations" where the driver counts them.
    WorkCount count_work() final;
    DeviceLimits measure_limits() final;
    std::optional<double> own_launch_seconds() final;
    /// What the driver keeps on disk is not known, so both times are the same.
    CompileTime compile_time() const final { return {compile_seconds_, compile_seconds_}; }

protected:
    /// Where the particles of a problem lie, and what a step dispatches.
    struct Layout {
        layout::Placement placement;
        std::vector<std::uint32_t> bits;  ///< one per particle
        glm::ivec3 groups{0};             ///< work groups of invocations
    };

    /// `shader`: the name of the file in shaders/.
    ComputeBackend(const Options& options, std::string shader);

    /// Empty, or why a problem cannot be run, provided that its words fit into a storage buffer.
    virtual std::string refused_layout(const Problem& problem) const = 0;
    virtual layout::Placement place(const Problem& problem) const = 0;
    /// Creates what the shader reads beyond shaders/compute.glsl.
    virtual Layout lay_out(const Problem& problem) = 0;
    /// Binds what lay_out() created, from first_own_binding on.
    virtual void bind_own() const = 0;
    /// Macros that specialise the shader beyond the terms that all shaders have.
    virtual Defines specialise(const Problem& problem) const = 0;
    virtual void set_uniforms(const Program& program, const Problem& problem) = 0;

    static constexpr GLuint first_own_binding = glsl::first_own_binding;
    /// Goes on with `edited`. The caller takes care of its springs.
    void set_problem(const Problem& edited);
    /// Lays out the lists of the edited problem anew. The particles stay where they are.
    void lay_out_anew();
    /// Runs an edit's program between the steps before and after. It has 64 invocations per work group, which
    /// stride over `count` things. Afterwards nothing is left bound.
    void dispatch_edit(const Program& program, std::size_t count);
    /// Writes new bits of particles. Every step copies the bits from the words that it reads.
    void write_bits(std::span<const std::uint32_t> particles, std::span<const std::uint32_t> bits);
    /// Empty, or why a storage buffer cannot have `bytes` bytes.
    std::string too_large(const char* what, std::uint64_t bytes) const;

private:
    std::string refused(const Problem& problem) const final;
    void enqueue_step() final;
    void restore_start() final;
    Defines divergence_defines() const final { return {{"STORAGE_BUFFERS", ""}}; }
    /// The buffers that steps write and later steps read.
    std::array<StorageBuffer*, 6> state_buffers() {
        return {&words_[0], &words_[1], &low_[0], &low_[1], &increment_, &increment_low_};
    }
    void enqueue_divergence_check() final;

    void make_program(const Problem& problem);
    /// Binds what stays bound from step to step.
    void bind() const;
    void bind_words() const;

    std::string shader_;
    bool through_textures_;
    GLbitfield barrier_;

    std::array<StorageBuffer, 2> words_, low_;
    std::array<Texture, 2> word_texture_, low_texture_;
    StorageBuffer increment_, increment_low_, load_, inverse_mass_;
    std::array<StorageBuffer, 6> start_;       ///< copies of state_buffers()
    std::map<std::string, Program> programs_;  // by text: an edit may go back to an earlier program
    const Program* program_ = nullptr;
    double compile_seconds_ = 0;
    Program bits_program_;
    StorageBuffer edited_;

    const Problem* problem_ = nullptr;
    Layout layout_;
    std::size_t current_ = 0;  // which of words_ has x(t)
};

}  // namespace voxspring::gl
