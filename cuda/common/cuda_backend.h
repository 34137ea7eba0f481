// What all CUDA backends share, whatever their kernels are: the device, its clock, and the replay of steps.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/blocks.h"
#include "backends/layout/records/resident.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/borders_first.h"
#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"
#include "cuda/device/device.h"
#include "cuda/device/kernel.h"
#include "cuda/device/limits.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// An array in device memory that steps write.
struct StateArray {
    void* data;
    std::size_t bytes;
};
template <class T>
StateArray state_array(const Buffer<T>& buffer) {
    return {buffer.data(), buffer.bytes()};
}

/// A backend with two position buffers. If it launches each step separately, the two swap roles: a step reads
/// one and writes the other.
class CudaBackend : public Backend, public LimitsFacet, public BorderFacet {
public:
    Capabilities capabilities() const override;
    std::string unsupported(const Problem& problem) const final;
    bool keep_start() final;
    void rewind() final;
    void step(int count) final;
    void monitor(const DivergenceMonitor& monitor) final { next_monitor_ = monitor; }
    std::optional<Divergence> divergence() final;
    void synchronize() final;
    CompileTime compile_time() const final { return compile_time_; }
    LimitsFacet* limits() final { return this; }
    DeviceLimits measure_limits() final { return cuda::measure_limits(device_, stream_); }
    bool prepare_exchanges(DeviceBorders& borders, int count) final;
    void step_and_exchange(DeviceBorders& borders, int count) final;

protected:
    const Device& device() const { return device_; }
    const Stream& stream() const { return stream_; }
    /// The problem that was last passed to set_problem(): that of the latest upload or edit.
    const Problem& problem() const { return *problem_; }
    void set_problem(const Problem& problem) { problem_ = &problem; }

    /// Whether border() returns a border. True for backends whose particles are all in device memory between
    /// two steps.
    virtual bool gives_borders() const { return false; }
    /// Whether a step can be split into two launches: the border, and the interior. A backend that returns
    /// true overrides split_steps() and enqueue_part().
    virtual bool splits_steps() const { return false; }
    /// To be called by device_borders(). If overlaps(way), steps are split from here on until the next call
    /// or upload(), and the result is the object that enqueues them. Otherwise the result is null. Throws
    /// Unavailable if the interior would have nothing to step.
    BordersFirst* enable_border_stream(const std::vector<SharedParticles>& borders, const std::string& way);
    /// Whether steps are split, so that borders are stepped first.
    bool is_split() const { return is_split_; }
    /// The limit for kernels that wait for another part of the body. check_waits() throws once a wait has
    /// exceeded it.
    WaitLimit border_wait();

    /// Ends a kernel that keeps running to wait for further steps, if there is one. Called before anything
    /// other than steps, moves of the tool and time stamps is enqueued.
    virtual void let_end() {}
    /// Waits for the stream without calling let_end(). Throws DeviceError if a launch has waited in vain.
    void wait_for_stream();
    /// Throws DeviceError if a launch has waited in vain. The text is failure_note(), or names the message
    /// from another part of the body that did not come.
    void check_waits() const;

    /// To be called first in upload(): waits for the device, frees the copy that keep_start() made and loads
    /// the kernels that run between steps.
    template <class Real>
    void begin_upload() {
        begin_upload();
        load_support_kernels<Real>(device_, compile_time_);
    }
    std::shared_ptr<const Kernel> kernel(const KernelSource& source) {
        return Kernel::get(source, device_, compile_time_);
    }

    /// Steps since upload() or rewind().
    std::int64_t steps() const { return steps_; }
    /// The buffer that holds x(t), 0 or 1.
    int current() const { return current_; }

    /// Counts steps from 0 again, and resets the tool and the divergence monitor. To be called once x(t) of
    /// the start is in buffer 0.
    void reset_to_step_zero();
    /// Drops captured graphs. To be called if enqueue_step() now enqueues other work than the graphs hold.
    void forget_graphs();

    /// To be called when `count` more steps have been enqueued: checks for divergence if a check is due.
    void stepped(int count);
    /// Whether a divergence monitor is set.
    bool monitored() const { return monitor_.every > 0; }
    /// Enqueues `count` steps and the checks between them. By default each step that is not split is launched
    /// by enqueue_step(). If replays_steps(), graphs of 1 to 256 such steps are replayed.
    virtual void enqueue_steps(int count);

private:
    void begin_upload();
    void launch_step(int reading) {
        enqueue_tool(reading);
        enqueue_step(reading);
    }

    /// Empty, or why the backend cannot run `problem`. Lack of device memory is not among the reasons.
    virtual std::string refused(const Problem& problem) const = 0;
    /// Bytes of device memory that upload(problem) would take, or an estimate or upper bound of these.
    /// bytes_held(): bytes that are allocated now.
    virtual std::uint64_t bytes_needed(const Problem& problem) const = 0;
    /// An upper bound of bytes_needed(), for backends that can compute one faster.
    virtual std::uint64_t max_bytes_needed(const Problem& problem) const { return bytes_needed(problem); }
    virtual std::uint64_t bytes_held() const = 0;
    /// The arrays in which a step leaves the state to the next step. rewind() restores them from the copies
    /// that keep_start() made, and rewound() restores whatever else a start needs.
    virtual std::vector<StateArray> state_arrays() const = 0;
    /// Called once rewind() has restored the state arrays of step 0.
    virtual void rewound() {}
    /// If the scene has a tool, enqueues the computation of its force on the particles that it holds, for the
    /// step that reads buffer `reading`.
    virtual void enqueue_tool(int) {}
    /// If the scene has a tool, moves it back to where it took hold of its particles (displacement 0).
    virtual void rest_tool() {}
    /// Enqueues one step that reads buffer `reading`. Called by this class's enqueue_steps() and its graphs.
    virtual void enqueue_step(int reading) = 0;
    /// Splits later steps into two launches. One steps the particles `border`, and others that are launched
    /// with them. The other, the interior, steps all others. Returns whether the interior has any particle.
    virtual bool split_steps(const std::vector<std::uint32_t>& /*border*/) { return false; }
    /// Enqueues one of the two launches of a split step (split_steps()) that reads buffer `reading`.
    virtual void enqueue_part(int /*reading*/, StepPart, const Stream&) {}
    /// Whether this class's enqueue_steps() replays steps from graphs. Otherwise it launches each step.
    virtual bool replays_steps() const { return true; }
    /// Whether the next step can be split.
    virtual bool splits_next_step() const { return true; }
    /// From here to rewind() or to the next upload every step does the same work, so that a graph with
    /// exchanges can replay them. Returns false if the backend's options forbid that.
    virtual bool make_steps_alike() { return true; }
    void enqueue_split_step();
    /// Calls enqueue(steps) for `count` steps in all. If divergence checks are frequent, no call goes beyond
    /// the next check. Otherwise there is one call.
    template <class Enqueue>
    void between_checks(int count, Enqueue enqueue);
    /// Enqueues `count` steps as graphs. graph(k) has to return the graph of 2^k steps.
    template <class GraphOf>
    void launch_graphs(int count, GraphOf graph);
    /// The graph of 2^k steps, each followed by an exchange. The first step reads buffer current().
    Graph& exchanging_graph(DeviceBorders& borders, int k);
    /// The kind of the next step, 0 or 1, for backends with two kinds of step. Each kind has its graphs.
    virtual int kind_of_step() const { return 0; }

    /// Empty, or a note that a launch waited in vain. The state is then worthless until the next upload.
    virtual std::string failure_note() const { return {}; }

    /// Enqueues a check of the current state. If the state has diverged, the kernel writes the numbers of
    /// this step and of the last check to `first`, unless an earlier check already did.
    virtual void enqueue_divergence_check(const DivergenceCheck& parameters, FirstDivergence* first) = 0;
    void check_divergence();

    void mark(Mark which) final { (which == Mark::begin ? begin_ : end_).record(stream_); }
    double seconds_between_marks() const final { return end_.seconds_since(begin_); }

    Device device_;  // declared first, so that its constructor runs first and reports a missing device
    Stream stream_;
    Event begin_, end_;
    const Problem* problem_ = nullptr;
    CompileTime compile_time_;
    int current_ = 0;
    DivergenceMonitor monitor_, next_monitor_;
    std::int64_t steps_ = 0;                    ///< since upload() or rewind()
    std::int64_t last_check_ = 0;               ///< the step of the last check
    Buffer<FirstDivergence> first_divergence_;  ///< one element
    std::vector<Buffer<std::byte>> start_;      ///< copies of the state arrays, for rewind()
    /// The longest graph has 2^8 steps, so that launching it takes next to no time compared with running it.
    static constexpr int graph_lengths = 9;
    /// graphs_[kind][b][k] runs 2^k steps, the first of which reads buffer b. A graph is captured when it is
    /// first launched. So a batch of steps of one kind that was run once since upload() captures nothing when
    /// it is timed from the same buffer.
    std::array<std::array<std::array<std::optional<Graph>, graph_lengths>, 2>, 2> graphs_;
    /// exchanging_graphs_[b][k]: like graphs_, but an exchange of borders follows each step.
    std::array<std::array<std::optional<Graph>, graph_lengths>, 2> exchanging_graphs_;
    Pinned<std::uint64_t> border_stall_;  ///< memory of WaitLimit::stall, which border_wait() allocates
    /// Set once a caller has asked for borders that are stepped first.
    std::optional<BordersFirst> borders_first_;
    bool is_split_ = false;
};

}  // namespace voxspring::cuda
