// What all OpenGL backends have: a context, the stopwatch, the divergence monitor, and the measurement of
// rest lengths.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "backends/gl/context.h"
#include "backends/gl/handles.h"
#include "backends/gl/program.h"
#include "backends/gl/step_queue.h"
#include "backends/gl/storage_buffer.h"
#include "backends/gl/tool_pass.h"
#include "backends/registry.h"

namespace voxspring::gl {

class GlBackend : public Backend, public FeedFacet, public LimitsFacet, public ToolFacet {
public:
    std::string unsupported(const Problem& problem) const final;
    void rewind() final;
    void step(int count) final;
    FeedFacet* feeds() final { return this; }
    LimitsFacet* limits() final { return this; }
    ToolFacet* tool() final { return this; }
    void move_tool(const glm::dvec3& displacement) final;
    glm::dvec3 tool_force() final;
    void monitor(const DivergenceMonitor& monitor) final { next_monitor_ = monitor; }
    std::optional<Divergence> divergence() final;
    void synchronize() final;

protected:
    explicit GlBackend(const Options& options);

    const Context& context() const { return context_; }
    const Options& options() const { return options_; }
    Formulation formulation() const { return formulation_; }
    /// Whether everything is compiled in, with neutral values where the problem lacks a term (tuning
    /// `terms`).
    bool all_terms() const { return all_terms_; }

    /// The pass of the tool, which upload() makes and a step dispatches first.
    ToolPass& tool_pass() { return tool_; }
    const ToolPass& tool_pass() const { return tool_; }

    /// The program of shaders/feed.comp. `defines`, the same in every call, specialise it beyond the
    /// formulation. It is compiled with the first feed and kept, since feeds come and go with each upload.
    const Program& feed_program(Defines defines);

    /// Returns to step 0. From here on the state is checked as monitor() last said.
    void reset_to_step_zero();

    /// Bytes of device memory that upload() takes (BackendEntry::bytes).
    virtual std::uint64_t bytes_needed(const Problem& problem) const = 0;
    /// Notes that upload() took `bytes` bytes, which the next upload() frees first.
    void hold(std::uint64_t bytes) { held_bytes_ = bytes; }

    /// Whether a copy of `bytes` bytes leaves half of the free memory to others.
    bool has_room_for(std::uint64_t bytes) const;

    /// Turns squares of rest lengths into rest lengths as the device measures them (physics/inverse_root.h).
    void measure(std::span<float> squares);
    /// Measures in place the numbers `offset`, `offset` + `stride` and so on of a buffer, `count` in all.
    void measure(const StorageBuffer& squares, std::size_t count, int stride, int offset);

private:
    /// Empty, or why the backend cannot run `problem` on a device with enough memory.
    virtual std::string refused(const Problem& problem) const = 0;
    /// Enqueues one step.
    virtual void enqueue_step() = 0;
    /// Restores what keep_start() kept.
    virtual void restore_start() = 0;
    /// Macros that specialise shaders/divergence_check.comp beyond the formulation.
    virtual Defines divergence_defines() const { return {}; }
    /// Binds the state for shaders/divergence_check.comp, whose program is in use, and dispatches it.
    virtual void enqueue_divergence_check() = 0;

    void mark(Mark which) final;
    double seconds_between_marks() const final;
    void check_divergence();

    Context context_;
    const Options options_;
    const Formulation formulation_;
    const bool all_terms_;
    StepQueue queue_;
    std::uint64_t held_bytes_ = 0;
    Query begin_, end_;
    Program measure_program_;
    Program monitor_program_;  // made with the first upload that is monitored
    ToolPass tool_;
    Program feed_program_;
    Buffer found_;                    // for shaders/divergence_check.comp
    std::int64_t steps_ = 0;          // since upload()
    DivergenceMonitor monitor_;       // for this run
    DivergenceMonitor next_monitor_;  // for the next run
};

/// The macros that specialise shaders/motion.glsl: the formulation and its constants.
Defines term_defines(const Problem& problem, Formulation formulation, bool all);

}  // namespace voxspring::gl
