// The host's side of a kernel that serves ticks without ending (records/ticks.h): it numbers them, writes
// orders and reads answers. Knows no device: the memory may be any that the kernel reaches meanwhile.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "backends/layout/records/ticks.h"

namespace voxspring::cuda {

/// Gives one order at a time: the next one only after the answer to the last.
class TickDesk {
public:
    /// `tick`: the number before the first one's.
    explicit TickDesk(std::uint32_t tick = 0) { order_.tick = tick; }

    /// From now on orders go to `asked`, and `answers` has room for one of each particle that the tool holds,
    /// one at least. No kernel is running. Overwrites both.
    void open(OrderWords* asked, std::span<AnswerWords> answers);

    /// Orders `steps` steps, one at least, with the tool there.
    void order(Vector<float> moved, std::uint32_t steps);
    /// Repeats the latest order in a new tick: the kernel had ended without taking it.
    void order_again();
    /// Orders the kernel to store the state and to end. There will be no answer; the next order waits for the
    /// end.
    void order_end();

    /// Number of the latest order's tick: what a kernel that is launched now begins with.
    std::uint32_t tick() const { return order_.tick; }
    std::uint32_t steps() const { return order_.steps; }
    /// Whether all of the answer to the latest order has arrived. It is there for good then.
    bool answered();
    /// The forces of the latest order that was answered.
    const std::vector<HeldForce<float>>& forces() const { return forces_; }

private:
    void write();

    OrderWords* asked_ = nullptr;
    std::span<AnswerWords> answers_;
    /// Its number goes on from kernel to kernel, so that no word of an earlier one is taken for an answer or
    /// an order. After 2^32 ticks numbers begin anew; every word has had another one since then.
    TickOrder order_{};
    std::size_t arrived_ = 0;  ///< answers to the latest order, one after another
    std::vector<HeldForce<float>> forces_;
};

}  // namespace voxspring::cuda
