// The host's side of a kernel that serves ticks without ending (records/ticks.h): TickDesk numbers the ticks,
// writes orders and reads answers. It knows no device: it works with any memory that the kernel can reach
// while it runs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "backends/layout/records/ticks.h"

namespace voxspring::layout {

/// Gives one order at a time: the next one only after the last one has been answered.
class TickDesk {
public:
    /// The first tick gets the number `tick` + 1.
    explicit TickDesk(std::uint32_t tick = 0) { order_.tick = tick; }

    /// From now on order() writes to `asked`, and answered() reads `answers`, where the kernel writes.
    /// `answers` has one element per particle that the tool holds, and at least one. The contents of both are
    /// overwritten. No kernel may be running.
    void open(OrderWords* asked, std::span<AnswerWords> answers);

    /// Orders `steps` steps, at least one, with the tool at `moved`.
    void order(Vector<float> moved, std::uint32_t steps);
    /// Repeats the latest order in a new tick, for when the kernel ended without taking it.
    void order_again();
    /// Orders the kernel to store the state and to end. It gives no answer. Order again only after its end.
    void order_end();

    /// Number of the tick that was ordered last. A kernel that is launched now waits for this tick first, so
    /// that it does not take an older order for a new one.
    std::uint32_t tick() const { return order_.tick; }
    std::uint32_t steps() const { return order_.steps; }
    /// Whether the answer to the latest order has arrived completely. Once true, it stays so.
    bool answered();
    /// The forces of the latest order that was answered.
    const std::vector<HeldForce<float>>& forces() const { return forces_; }

private:
    void write();

    OrderWords* asked_ = nullptr;
    std::span<AnswerWords> answers_;
    /// Tick numbers go on from kernel to kernel, so that no word of an earlier kernel is taken for an answer
    /// or an order. They start again after 2^32 ticks, when every word has long been overwritten.
    TickOrder order_{};
    std::size_t arrived_ = 0;  ///< how many answers to the latest order have been read, one after another
    std::vector<HeldForce<float>> forces_;
};

}  // namespace voxspring::layout
