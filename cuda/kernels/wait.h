// How blocks of one launch, and launches that step parts of one body, wait for each other, and how a wait in
// vain ends. This is device code. The host can run it too if the built-in functions of a device are provided
// (tests/host_blocks.h).
//
// A wait that lasts for too long marks WaitLimit::stall, where the host reads it, and ends. The thread that
// waited goes on without what it waited for; every other wait, later ones of this thread included, ends as
// soon as it sees the mark. So the launch ends soon after, and its state is worthless. A trap would end the
// launch at once. But it would also end all other work of the process on the device, and all processes that
// share the device by MPS.
#pragma once

#include "backends/layout/records/loops.h"
#include "backends/layout/records/resident.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
/// To be called once this block has read the data that others overwrite after all blocks are counted.
__device__ inline void count_block(std::uint32_t* counted_blocks) {
    asm volatile("red.release.gpu.global.add.u32 [%0], 1;" ::"l"(counted_blocks) : "memory");
}
__device__ inline std::uint32_t read_count(const std::uint32_t* counted_blocks) {
    std::uint32_t counted = 0;
    asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(counted) : "l"(counted_blocks) : "memory");
    return counted;
}

/// The time of a clock that does not depend on the card's frequency or load.
__device__ inline std::uint64_t nanoseconds() {
    std::uint64_t now = 0;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(now)::"memory");
    return now;
}

__device__ inline std::uint64_t read_mark(const std::uint64_t* stall) {
    return *static_cast<const volatile std::uint64_t*>(stall);
}
__device__ inline void write_mark(std::uint64_t* stall, std::uint64_t mark) {
    *static_cast<volatile std::uint64_t*>(stall) = mark;
}

/// A wait reads the clock once per this many looks in vain, which take some milliseconds.
inline constexpr std::uint32_t looks_between_clocks = 1U << 12;

/// Waits for all of `threads` threads of a block at one of the hardware's barriers. __syncthreads() uses 0.
template <int barrier, int threads>
__device__ void meet() {
    asm volatile("bar.sync %0, %1;" ::"n"(barrier), "n"(threads) : "memory");
}
#endif

/// A wait of one thread that ends after a time limit. `number`: the step or message to report if it ends so.
class BoundedWait {
public:
    __device__ BoundedWait(const WaitLimit& limit, std::uint32_t number) : limit_(limit), number_(number) {}

    /// To be called after each look in vain. Returns whether to give up. The clock and the mark are read only
    /// once per looks_between_clocks calls, some milliseconds apart, since few waits last for that long.
    __device__ bool is_over() {
        if (++looks_ % looks_between_clocks != 0) return false;
        const std::uint32_t now = ticks_of(nanoseconds());
        if (looks_ == looks_between_clocks) began_ = now;
        if (read_mark(limit_.stall) != 0) return true;
        if (now - began_ < ticks_of(limit_.nanoseconds)) return false;
        write_mark(limit_.stall, ResidentStall{blockIdx.x, number_}.packed());
        return true;
    }

private:
    /// The time in units of 2^20 ns, about a millisecond, so that 32 bits count for weeks.
    static __device__ std::uint32_t ticks_of(std::uint64_t nanoseconds) {
        return std::uint32_t(nanoseconds >> 20);
    }

    const WaitLimit& limit_;
    const std::uint32_t number_;
    std::uint32_t looks_ = 0;
    std::uint32_t began_ = 0;
};

/// Waits until each of the words whose bits are set in `missing` has `tag`. load(n) reads word n, and
/// found(n, point) takes its point. Returns false if not all of the words came; the launch must then end.
/// `number`: the step to report if the wait is in vain. `loads_all`: words that have come are loaded again as
/// well, which saves a branch.
template <int count, bool loads_all, class Load, class Found>
__device__ bool wait_for_words(const WaitLimit& limit, std::uint32_t number, std::uint32_t missing,
                               std::uint32_t tag, Load load, Found found) {
    BoundedWait wait(limit, number);
    while (missing != 0) {
        TaggedPoint word[count];
        UNROLLED
        for (int n = 0; n < count; ++n) {
            if (loads_all || (missing >> n & 1U) != 0) word[n] = load(n);
        }
        UNROLLED
        for (int n = 0; n < count; ++n) {
            if ((missing >> n & 1U) == 0 || word[n].tag != tag) continue;
            found(n, word[n].point);
            missing &= ~(1U << n);
        }
        if (missing != 0 && wait.is_over()) return false;
    }
    return true;
}

/// Waits until `wanted` blocks have counted themselves in `counted_blocks`. What these blocks have read may
/// then be overwritten. `number`: the step to report if the wait is in vain. The result is then false, and
/// the launch must end.
__device__ inline bool wait_until_counted(const std::uint32_t* counted_blocks, std::uint32_t wanted,
                                          const WaitLimit& limit, std::uint32_t number) {
    BoundedWait wait(limit, number);
    while (int(read_count(counted_blocks) - wanted) < 0) {
        if (wait.is_over()) return false;
    }
    return true;
}

}  // namespace voxspring::cuda
