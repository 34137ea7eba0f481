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

/// Waits until `wanted` blocks have counted themselves in `started_blocks`: all have read their start from
/// memory, so that this one may overwrite it after step `number`.
__device__ inline void wait_until_all_have_started(const std::uint32_t* started_blocks, std::uint32_t wanted,
                                                   std::uint64_t* stall, std::uint32_t number) {
    std::uint32_t polls_in_vain = 0;
    while (true) {
        std::uint32_t started = 0;
        asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(started) : "l"(started_blocks) : "memory");
        if (int(started - wanted) >= 0) return;
        if (++polls_in_vain == max_resident_polls) give_up(stall, number);
    }
}
#endif

}  // namespace voxspring::cuda
