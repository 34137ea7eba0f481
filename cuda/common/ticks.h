// A launch that goes on from tick to tick. In a tick the host moves the tool, orders some steps, and reads
// the force on the tool. The launch takes these steps, waits for the next tick, and ends when the host orders
// the end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "backends/layout/tick_desk.h"
#include "cuda/device/buffer.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// The host's side of such a launch. Orders and answers are in pinned memory, which the device reads and
/// writes in place. The owner of a Ticks calls end() before enqueuing anything else but time stamps in the
/// stream, and before destroying the Ticks.
class Ticks {
public:
    /// Enqueues a launch that begins with the latest order. `again`: the steps of that order if an earlier
    /// launch ended before it took them, otherwise 0.
    using Launch = std::function<void(const TickLine& line, std::uint32_t again)>;
    /// `wait_for_stream()` throws DeviceError if what ran in the stream has failed.
    Ticks(const Stream& stream, Launch launch, std::function<void()> wait_for_stream)
        : stream_(stream), launch_(std::move(launch)), wait_for_stream_(std::move(wait_for_stream)) {}

    /// Prepares for a tool that holds `held` particles, at least one. No launch may be running.
    void open(std::size_t held);
    std::uint64_t bytes() const { return handed_on_.bytes() + taken_blocks_.bytes(); }

    /// Waits for the answer to the previous order. Then orders `steps` steps with the tool at `moved`, from
    /// the running launch or else from a new one.
    void order(Vector<float> moved, std::uint32_t steps);
    /// Waits for the answer to the previous order, orders the launch to end, and waits until it has. Does
    /// nothing if no launch is running.
    void end();
    /// Waits for the answer to the latest order and returns its forces, one per held particle.
    const std::vector<HeldForce<float>>& forces();

private:
    /// Waits for the answer to the latest order. A launch ends by itself if it sees no order for too long
    /// (max_idle_nanoseconds), maybe just before it would have seen the latest one. If it has ended without
    /// an answer, another launch is started. If that one ends without an answer too, this function throws
    /// DeviceError. So the wait is bounded, as every wait in a launch is.
    void wait();
    void begin(std::uint32_t again);

    const Stream& stream_;
    Launch launch_;
    std::function<void()> wait_for_stream_;
    Pinned<OrderWords> asked_;
    Pinned<AnswerWords> answers_;
    Buffer<OrderWords> handed_on_;
    Buffer<std::uint32_t> taken_blocks_;
    TickDesk desk_;
    bool running_ = false;  ///< the latest launch was not told to end, but may have ended by itself
};

}  // namespace voxspring::cuda
