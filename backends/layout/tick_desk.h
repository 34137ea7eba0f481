// The host's side of a kernel that does not end after a tick but waits for the next (records/ticks.h). In a
// tick the host orders steps with the tool at a new place, and the kernel answers with the tool's forces.
// TickDesk numbers the ticks, writes orders and reads answers. It calls no device: it works with any memory
// that the kernel can reach while it runs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "backends/layout/records/ticks.h"

namespace voxspring::layout {

/// Gives one order at a time. The next order must wait until the last one has been answered.
class TickDesk {
public:
    /// The first tick gets the number `tick` + 1.
    explicit TickDesk(std::uint32_t tick = 0) { order_.tick = tick; }

    /// Sets the memory of the messages: order() writes to `asked`, and answered() reads `answers`, where the
    /// kernel writes. `answers` has one element per particle that the tool holds, and at least one. The
    /// contents of both are overwritten. No kernel may be running.
    void open(OrderWords* asked, std::span<AnswerWords> answers);

    /// Orders `steps` steps, at least one, with the tool at `moved`.
    void order(Vector<float> moved, std::uint32_t steps);
    /// Repeats the latest order under a new tick number. To be called if the kernel ended before it took the
    /// order.
    void order_again();
    /// Orders the kernel to store the state and to end, which the kernel does not answer. After this, order()
    /// may be called once the kernel has ended.
    void order_end();

    /// The number of the tick that was ordered last. A kernel that is launched now has to wait for this tick
    /// first, so that it does not take an older order for a new one.
    std::uint32_t tick() const { return order_.tick; }
    std::uint32_t steps() const { return order_.steps; }
    /// Whether the answer to the latest order has arrived completely. Once true, it stays true until the next
    /// order.
    bool answered();
    /// The forces of the latest order that was answered. Not valid while answered() is false.
    const std::vector<HeldForce<float>>& forces() const { return forces_; }

private:
    void write();

    OrderWords* asked_ = nullptr;
    std::span<AnswerWords> answers_;
    /// Tick numbers go on from one kernel to the next, so that no word of an earlier kernel is taken for a
    /// later answer or order. After 2^32 ticks they start again from 0, when every word has long been
    /// overwritten.
    TickOrder order_{};
    std::size_t arrived_ = 0;  ///< how many answers to the latest order have been read, in order
    std::vector<HeldForce<float>> forces_;
};

}  // namespace voxspring::layout
