// What the backends that step by compute shaders share: the state in storage buffers, one dispatch a step and
// the barrier after it, and edits of particles' bits (README.md).
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
    /// Of what the driver itself keeps on disk nothing is known.
    CompileTime compile_time() const final { return {compile_seconds_, compile_seconds_}; }

protected:
    /// Where the particles of a problem go, and what a step dispatches.
    struct Layout {
        cuda::Placement placement;
        std::vector<std::uint32_t> bits;  ///< one per particle
        glm::ivec3 groups{0};             ///< of invocations
    };

    /// `shader`: the file in shaders/.
    ComputeBackend(const Options& options, std::string shader);

    /// Empty, or why a problem cannot be run that has no more words than a storage buffer holds.
    virtual std::string refused_layout(const Problem& problem) const = 0;
    virtual cuda::Placement place(const Problem& problem) const = 0;
    /// Creates what the shader reads beyond shaders/compute.glsl.
    virtual Layout lay_out(const Problem& problem) = 0;
    /// Binds it, from first_own_binding on.
    virtual void bind_own() const = 0;
    /// What specialises the shader beyond the terms that all have.
    virtual Defines specialise(const Problem& problem) const = 0;
    virtual void set_uniforms(const Program& program, const Problem& problem) = 0;

    static constexpr GLuint first_own_binding = glsl::first_own_binding;
    /// Goes on with `edited`, whose springs the caller sees to.
    void set_problem(const Problem& edited);
    /// Lays out anew what the problem now has, for the particles where they are.
    void lay_out_anew();
    /// Runs an edit's program of 64 invocations a work group, which stride over `count` things, between the
    /// steps before and after. Leaves what it bound bound no longer.
    void dispatch_edit(const Program& program, std::size_t count);
    /// Gives particles new bits, which every step copies on from the words that it reads.
    void write_bits(std::span<const std::uint32_t> particles, std::span<const std::uint32_t> bits);
    /// Empty, or why a storage buffer cannot have so many bytes.
    std::string too_large(const char* what, std::uint64_t bytes) const;

private:
    std::string refused(const Problem& problem) const final;
    void enqueue_step() final;
    void restore_start() final;
    Defines divergence_defines() const final { return {{"STORAGE_BUFFERS", ""}}; }
    /// What steps write and later steps read.
    std::array<StorageBuffer*, 6> state_buffers() {
        return {&words_[0], &words_[1], &low_[0], &low_[1], &increment_, &increment_low_};
    }
    void enqueue_divergence_check() final;

    void make_program(const Problem& problem);
    /// What stays bound from step to step.
    void bind() const;
    void bind_words() const;

    std::string shader_;
    bool through_textures_;
    GLbitfield barrier_;

    std::array<StorageBuffer, 2> words_, low_;
    std::array<Texture, 2> word_texture_, low_texture_;
    StorageBuffer increment_, increment_low_, load_, inverse_mass_;
    std::array<StorageBuffer, 6> start_;       ///< copies of state_buffers()
    std::map<std::string, Program> programs_;  // by their text: an edit may go back to the one before
    const Program* program_ = nullptr;
    double compile_seconds_ = 0;
    Program bits_program_;
    StorageBuffer edited_;

    const Problem* problem_ = nullptr;
    Layout layout_;
    std::size_t current_ = 0;  // of words_: x(t)
};

}  // namespace voxspring::gl
