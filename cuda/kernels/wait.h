// How blocks of one launch wait for each other, and end if that is in vain. Device code alone.
#pragma once

#include "backends/layout/records/resident.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
/// Ends the launch with all of its blocks, after a wait in vain for step `number`. `stall`: where the host
/// reads which block that was.
__device__ inline void give_up(std::uint64_t* stall, std::uint32_t number) {
    *static_cast<volatile std::uint64_t*>(stall) = ResidentStall{blockIdx.x, number}.packed();
    __threadfence_system();
    __trap();
}

/// A block has read what others are to overwrite.
__device__ inline void count_block(std::uint32_t* counted_blocks) {
    asm volatile("red.release.gpu.global.add.u32 [%0], 1;" ::"l"(counted_blocks) : "memory");
}

/// Waits until `wanted` blocks have counted themselves in `counted_blocks`, so that what they have read may
/// be overwritten. `number`: of the latest step.
__device__ inline void wait_until_counted(const std::uint32_t* counted_blocks, std::uint32_t wanted,
                                          std::uint64_t* stall, std::uint32_t number) {
    std::uint32_t polls_in_vain = 0;
    while (true) {
        std::uint32_t counted = 0;
        asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(counted) : "l"(counted_blocks) : "memory");
        if (int(counted - wanted) >= 0) return;
        if (++polls_in_vain == max_resident_polls) give_up(stall, number);
    }
}

/// By a clock that goes on whatever the card does.
__device__ inline std::uint64_t nanoseconds() {
    std::uint64_t now = 0;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(now)::"memory");
    return now;
}

/// Waits for all of `threads` threads of a block at one of the hardware's barriers. __syncthreads() uses 0.
template <int barrier, int threads>
__device__ void meet() {
    asm volatile("bar.sync %0, %1;" ::"n"(barrier), "n"(threads) : "memory");
}
#endif

}  // namespace voxspring::cuda
