// A launch that goes on from tick to tick: it takes the steps that the host orders for each tick, and ends
// when the host orders the end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "backends/layout/tick_desk.h"
#include "cuda/device/buffer.h"
#include "cuda/device/pinned.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// Orders and answers are in pinned memory, which the device reads and writes in place. The owner of a Ticks
/// calls end() before it enqueues anything else in the stream, and before it destroys this.
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

    /// Orders `steps` steps from the running launch, or from a new one, once the previous order is answered.
    void order(Vector<float> moved, std::uint32_t steps);
    /// Orders the end once the previous order is answered, and waits for it. Does nothing if no launch is
    /// running.
    void end();
    /// The forces of the latest order, once it is answered.
    const std::vector<HeldForce<float>>& forces();

private:
    /// Waits for the answer to the latest order. A launch ends by itself if it sees no order for too long
    /// (max_idle_nanoseconds), maybe just before it would have seen the latest one. Then another launch is
    /// started; if that ends without an answer as well, this throws. So the wait is bounded, as every wait in
    /// a launch is.
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
