// How a resident kernel that goes on from tick to tick receives the host's orders, and answers them, by the
// words of backends/layout/records/ticks.h. (In a tick the host moves the tool, orders some steps, and reads
// the force on the tool.) This is device code, which the host can run too, like resident_block.h.
#pragma once

#include "backends/layout/records/ticks.h"
#include "cuda/kernels/wait.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
// Relaxed accesses with the scope of the system: each word is read and written whole, and words come in any
// order.

/// Reads two words. They may belong to different orders, so the caller has to check both tags.
__device__ inline void read_words(const std::uint64_t* from, std::uint64_t* to) {
    asm volatile("ld.relaxed.sys.global.v2.u64 {%0, %1}, [%2];"
                 : "=l"(to[0]), "=l"(to[1])
                 : "l"(from)
                 : "memory");
}
__device__ inline void write_word(std::uint64_t* to, std::uint64_t word) {
    asm volatile("st.relaxed.sys.global.u64 [%0], %1;" ::"l"(to), "l"(word) : "memory");
}
#endif

/// Whether all words of the order of tick `tick` have arrived at `from`. If so, `order` is set.
__device__ inline bool look_for_order(const OrderWords* from, std::uint32_t tick, TickOrder& order) {
    OrderWords found;
    read_words(from->word, found.word);
    read_words(from->word + 2, found.word + 2);
    for (const std::uint64_t word : found.word) {
        if (tick_of(word) != tick) return false;
    }
    order = {{real_in(found.word[0]), real_in(found.word[1]), real_in(found.word[2])},
             count_in(found.word[3]),
             tick};
    return true;
}

__device__ inline void hand_on(const TickOrder& order, OrderWords* to) {
    write_word(to->word, tick_word(order.moved.x, order.tick));
    write_word(to->word + 1, tick_word(order.moved.y, order.tick));
    write_word(to->word + 2, tick_word(order.moved.z, order.tick));
    write_word(to->word + 3, tick_word(order.steps, order.tick));
}

__device__ inline void answer(Vector<float> force, std::uint32_t tick, AnswerWords* to) {
    write_word(to->word, tick_word(force.x, tick));
    write_word(to->word + 1, tick_word(force.y, tick));
    write_word(to->word + 2, tick_word(force.z, tick));
}

/// Waits for the order of tick `tick`, in one thread of each block. Block 0 reads what the host writes, which
/// has to cross the bus, and hands it on to the other blocks. If the host is silent for too long, block 0
/// orders the end. If another block does not take its orders, block 0 looks for the host's order only once
/// more, and orders the end if there is none. `step`: the latest step, to be reported if a wait is in vain.
__device__ inline TickOrder wait_for_order(const TickLine& line, std::uint32_t tick, const WaitLimit& limit,
                                           std::uint32_t step) {
    TickOrder order{{0, 0, 0}, 0, tick};
    if (blockIdx.x == 0) {
        // The new order may replace the previous one only once every block has read the previous one.
        bool late = !wait_until_counted(line.taken_blocks, (tick - line.first_tick) * gridDim.x, limit, step);
        const std::uint64_t begin = nanoseconds();
        // Look for the order once more after the time is over: another process may have had the card until
        // then.
        while (!look_for_order(line.asked, tick, order) && !late)
            late = nanoseconds() - begin > line.max_idle;
        hand_on(order, line.handed_on);
    } else {
        BoundedWait wait(limit, step);
        while (!look_for_order(line.handed_on, tick, order)) {
            if (wait.is_over()) break;
        }
    }
    count_block(line.taken_blocks);
    return order;
}

}  // namespace voxspring::cuda
