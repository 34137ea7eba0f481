// The messages of the host and a kernel that stays on the device for many ticks (cuda/kernels/ticks.h), in
// memory that both can reach. In a tick the host says where the tool is and how many steps to take, and the
// kernel answers with the tool's forces. Every value is in a word of 8 bytes with the number of its tick.
// Such a word is written and read whole: once the number has arrived, so has the value, and words may arrive
// in any order.
#pragma once

#include "backends/layout/records/tool.h"

namespace voxspring::layout {

/// A word of a message: the number of the tick in the upper half, the value in the lower half.
VOXSPRING_HOST_DEVICE constexpr std::uint64_t tick_word(std::uint32_t value, std::uint32_t tick) {
    return std::uint64_t(tick) << 32 | value;
}
VOXSPRING_HOST_DEVICE constexpr std::uint64_t tick_word(float value, std::uint32_t tick) {
    return tick_word(__builtin_bit_cast(std::uint32_t, value), tick);
}
VOXSPRING_HOST_DEVICE constexpr std::uint32_t tick_of(std::uint64_t word) {
    return std::uint32_t(word >> 32);
}
VOXSPRING_HOST_DEVICE constexpr std::uint32_t count_in(std::uint64_t word) { return std::uint32_t(word); }
VOXSPRING_HOST_DEVICE constexpr float real_in(std::uint64_t word) {
    return __builtin_bit_cast(float, std::uint32_t(word));
}

/// What the host orders the kernel to do in a tick.
struct TickOrder {
    Vector<float> moved;  ///< how far the tool has moved since it took hold
    std::uint32_t steps;  ///< 0: the kernel stores the state and ends
    std::uint32_t tick;
};

/// A TickOrder as words (tick_word()): x, y and z of `moved`, and `steps`.
struct alignas(32) OrderWords {
    std::uint64_t word[4];
};

/// The kernel's answer for one held particle: the force of the tool on it in the last step of a tick, as
/// words of x, y and z.
struct alignas(32) AnswerWords {
    std::uint64_t word[3];
};

/// A kernel ends by itself if the host orders nothing for this long. Only block 0 looks for the host's
/// orders. The other blocks wait longer for block 0 (max_wait_nanoseconds).
inline constexpr std::uint64_t max_idle_nanoseconds = 1'000'000'000;

/// The memory through which orders and answers go.
struct TickLine {
    const OrderWords* asked;  ///< in the host's memory; the host writes it
    OrderWords* handed_on;    ///< in device memory; block 0 writes it for all other blocks
    /// How many times a block has read an order, counted over all blocks and all ticks of this launch.
    std::uint32_t* taken_blocks;
    AnswerWords* answers;      ///< in the host's memory: one for each particle that the tool holds
    std::uint32_t first_tick;  ///< number of this launch's first tick; the next ticks count up from it
    std::uint64_t max_idle;    ///< in nanoseconds
};

}  // namespace voxspring::layout
