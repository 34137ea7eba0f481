// What the host and a resident kernel that does not end tell each other (cuda/kernels/ticks.h), in memory
// that both can reach. Every value is in a word of 8 bytes with the number of its tick. Such a word is
// written and read whole: once the number has arrived, so has the value, and words may arrive in any order.
#pragma once

#include "backends/layout/records/tool.h"

namespace voxspring::layout {

/// A word: the number of the tick in the upper half, the value in the lower half.
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

/// What the host orders in a tick.
struct TickOrder {
    Vector<float> moved;  ///< where the tool is: ToolState::moved
    std::uint32_t steps;  ///< 0: the kernel stores the state and ends
    std::uint32_t tick;
};

/// A TickOrder as words (tick_word()): x, y and z of `moved`, and `steps`.
struct alignas(32) OrderWords {
    std::uint64_t word[4];
};

/// The force of the tool on a held particle in the last step of a tick, as words: x, y and z.
struct alignas(32) AnswerWords {
    std::uint64_t word[3];
};

/// A kernel ends by itself if the host orders nothing for this long. Only block 0 looks for the host's
/// orders. The other blocks wait longer for block 0 (max_wait_nanoseconds).
inline constexpr std::uint64_t max_idle_nanoseconds = 1'000'000'000;

/// Where orders and answers lie.
struct TickLine {
    const OrderWords* asked;  ///< in the host's memory; the host writes it
    OrderWords* handed_on;    ///< in device memory; block 0 writes it for all other blocks
    /// How many blocks have read their order, counted over all ticks of this launch.
    std::uint32_t* taken_blocks;
    AnswerWords* answers;      ///< in the host's memory: one for each particle that the tool holds
    std::uint32_t first_tick;  ///< number of this launch's first tick; the next ticks count up from it
    std::uint64_t max_idle;    ///< in nanoseconds
};

}  // namespace voxspring::layout
