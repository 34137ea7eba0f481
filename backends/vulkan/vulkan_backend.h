// What all Vulkan backends have: the state in storage buffers, steps recorded once and replayed, edits of
// particles' bits, the stopwatch and the divergence monitor (README.md).
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "backends/glsl/compute.h"
#include "backends/pace.h"
#include "backends/registry.h"
#include "backends/vulkan/program.h"

namespace voxspring::vulkan {

class VulkanBackend : public Backend, public LimitsFacet, public ToolFacet {
public:
    ~VulkanBackend() override;
    Capabilities capabilities() const final { return device_.capabilities(); }
    std::string unsupported(const Problem& problem) const final;
    void upload(const Problem& problem, const State& state) final;
    bool keep_start() final;
    void rewind() final;
    void edit(const Problem& edited, const SpringEdit& edit) final;
    void step(int count) final;
    void monitor(const DivergenceMonitor& monitor) final { next_monitor_ = monitor; }
    std::optional<Divergence> divergence() final;
    LimitsFacet* limits() final { return this; }
    ToolFacet* tool() final { return this; }
    void move_tool(const glm::dvec3& displacement) final;
    glm::dvec3 tool_force() final;
    void synchronize() final;
    State download() final;
    /// "work_groups", and "compute_shader_invocations" where the driver counts them.
    WorkCount count_work() final;
    CompileTime compile_time() const final { return compile_time_; }
    DeviceLimits measure_limits() final;

    const Device& device() const { return device_; }

protected:
    /// Where the particles of a problem lie, and what a step dispatches.
    struct Layout {
        layout::Placement placement;
        std::vector<std::uint32_t> bits;  ///< one per particle
        glm::ivec3 groups{0};             ///< work groups of invocations
    };

    /// `group`: extents of the shader's work groups.
    VulkanBackend(const Options& options, glm::ivec3 group);

    const Options& options() const { return options_; }
    Formulation formulation() const { return options_.formulation; }
    /// Whether everything is compiled in, with neutral values where the problem lacks a term (tuning
    /// `terms`).
    bool all_terms() const { return options_.tuning.at("terms") == "all"; }

    /// The name of the step's modules without formulation and precision. It is asked for after lay_out().
    virtual std::string shader() const = 0;
    /// Bytes of device memory that upload() takes (BackendEntry::bytes).
    virtual std::uint64_t bytes_needed(const Problem& problem) const = 0;
    /// Empty, or why a problem cannot be run, provided that its words fit into a storage buffer.
    virtual std::string refused_layout(const Problem& problem) const = 0;
    virtual layout::Placement place(const Problem& problem) const = 0;
    /// Fills own() with what the shader reads beyond shaders/compute.glsl. No command is running.
    virtual Layout lay_out(const Problem& problem) = 0;
    /// Constants of the shader beyond those of shaders/terms.glsl.
    virtual glsl::Constants constants(const Problem& problem) const = 0;
    virtual void set_uniforms(Uniforms& uniforms, const Problem& problem) = 0;
    /// Does the work of edit(). An error of Vulkan may pass through.
    virtual void enqueue_edit_of(const Problem& edited, const SpringEdit& edit) = 0;

    Queue& queue() { return queue_; }
    /// A storage buffer that only this shader has, by binding from glsl::first_own_binding on; empty at
    /// first.
    Buffer& own(std::uint32_t binding) { return own_[binding]; }
    /// Lays out the lists of the edited problem anew. The particles stay where they are. Waits.
    void lay_out_anew();
    /// A shader of the build for this precision, specialised.
    std::shared_ptr<const Program> program(const std::string& shader, const glsl::Constants& constants = {},
                                           glm::ivec3 group = {64, 1, 1});
    /// A buffer with `values` that the device can read, for enqueue_dispatch().
    template <class T>
    std::shared_ptr<const Buffer> send(const std::vector<T>& values) {
        return sent_once_.holding(std::as_bytes(std::span(values)));
    }
    /// Enqueues a program that strides over `count` things, between the steps before and after. Keeps the
    /// buffers `sent`, which it reads, until it has run.
    void enqueue_dispatch(const std::shared_ptr<const Program>& program, std::size_t count,
                          const Uniforms& uniforms, const Buffers& buffers,
                          const std::vector<std::shared_ptr<const Buffer>>& sent);
    /// Writes new bits of particles. Every step copies the bits from the words that it reads.
    void write_bits(std::span<const std::uint32_t> particles, std::span<const std::uint32_t> bits);
    /// Puts values into a buffer, whose memory is new unless it has the same size. Waits.
    template <class T>
    void put(Buffer& buffer, const std::vector<T>& values) {
        put(buffer, std::as_bytes(std::span(values)));
    }
    /// Measures rest lengths from their squares, as the device does (physics/inverse_root.h), in place: the
    /// numbers `offset`, `offset` + `stride` and so on of a buffer, `count` in all. Waits.
    void measure(const Buffer& squares, std::size_t count, int stride, int offset);
    /// Measures numbers on the host in the same way.
    template <class Real>
    void measure_numbers(std::span<Real> squares) {
        Buffer buffer(device_, squares.size_bytes(), Place::device);
        queue_.upload(buffer, std::as_bytes(squares));
        measure(buffer, squares.size(), 1, 0);
        queue_.download(buffer, std::as_writable_bytes(squares));
    }

private:
    /// One pass that reads words 0 and one that reads words 1, with what was recorded of them.
    struct Stepping;
    struct Checking;
    /// The tool's passes before a step that reads words 0 or words 1, and the present state of the tool.
    struct Holding;

    void mark(Mark which) final;
    double seconds_between_marks() const final;

    void put(Buffer& buffer, std::span<const std::byte> values);
    template <class Real>
    void upload_state(const Problem& problem, const State& state);
    template <class Real>
    State download_state();
    void make_stepping();
    void make_checking();
    template <class Real>
    void make_holding();
    template <class Real>
    Uniforms tool_uniforms(const Module& module, const glm::dvec3& moved) const;
    template <class Real>
    glm::dvec3 read_tool_force();
    void reset_to_step_zero();
    /// The program of stepping_ is bound before and after this call.
    void dispatch_step(const Commands& commands, std::size_t current) const;
    /// The recording of 2^power steps from the current words.
    const Commands& steps(int power);
    /// Hands over `count` steps, in submissions of pace_.steps() steps.
    void enqueue_steps(int count);
    /// Called when `steps` more steps are enqueued. Enqueues a check if one is due.
    void have_enqueued(int steps);
    Buffers buffers(std::size_t current) const;
    /// The buffers that steps write and later steps read.
    std::array<Buffer*, 6> state_buffers() {
        return {&words_[0], &words_[1], &low_[0], &low_[1], &increment_, &increment_low_};
    }

    Device device_;
    const Options options_;
    const glm::ivec3 group_;
    vk::raii::QueryPool marks_;
    // Programs by name and constants: an edit may go back to an earlier one.
    std::map<std::string, std::shared_ptr<const Program>> programs_;
    Buffer nothing_;  // bound where a shader has no use for a buffer
    std::array<Buffer, 2> words_, low_;
    Buffer increment_, increment_low_, load_, inverse_mass_;
    std::map<std::uint32_t, Buffer> own_;
    std::array<Buffer, 6> start_;  // copies of state_buffers()
    Buffer found_;                 // for shaders/divergence_check.comp
    BufferPool sent_once_;
    Queue queue_;
    Pace pace_;
    std::array<Commands, 2> mark_;
    std::shared_ptr<Stepping> stepping_;
    std::shared_ptr<Checking> checking_;  // null: never checked
    std::shared_ptr<Holding> holding_;    // null: there is no tool
    CompileTime compile_time_;

    const Problem* problem_ = nullptr;
    Layout layout_;
    std::size_t current_ = 0;  // which of words_ has x(t)
    std::uint64_t held_bytes_ = 0;
    std::int64_t steps_ = 0;          // since upload()
    DivergenceMonitor monitor_;       // for this run
    DivergenceMonitor next_monitor_;  // for the next run
};

}  // namespace voxspring::vulkan
