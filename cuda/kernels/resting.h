// Blocks of an implicit kernel that rest.
//
// A step is a function of a block's particles and of those around it. Where the latest step changed no bit of
// them, the next one would change none either: it need not be taken (term_resting). What a step that is not
// taken would write stands there: x(t) and x(t - dt) of such a block are equal.
#pragma once

#include "cuda/kernels/terms.h"

namespace voxspring::cuda {

/// What a warp says of a step.
inline constexpr std::uint8_t warp_changed = 1, warp_stepped = 2;
/// The same of any warp of a block, a byte each.
inline constexpr std::uint64_t any_changed = 0x0101010101010101, any_stepped = any_changed * warp_stepped;

/// What the warps of each block said of a step. A frame of blocks that say nothing surrounds those of the
/// lattice, so that each of them has 26 neighbours.
struct BlockReports {
    int row, slice;               ///< from a block to the next along y and z
    const std::uint64_t* before;  ///< of the step that led to what this one reads
    std::uint64_t* after;         ///< of this one
    bool operator==(const BlockReports&) const = default;
};

/// Of that neighbour, less that of the block itself; number 13 is the block.
VOXSPRING_HOST_DEVICE inline int beside(const BlockReports& reports, int number) {
    return number % 3 - 1 + (number / 3 % 3 - 1) * reports.row + (number / 9 - 1) * reports.slice;
}

#ifdef __CUDACC__
__device__ inline unsigned thread_of_block() {
    return threadIdx.x + blockDim.x * (threadIdx.y + blockDim.y * threadIdx.z);
}
#endif

/// Whether `block` is to be stepped: it or one around it changed. All threads of a warp ask together.
template <class Terms>
VOXSPRING_HOST_DEVICE bool is_lively(const BlockReports& reports, int block) {
    if constexpr (!Terms::compiled(term_resting)) {
        return true;
    } else {
        constexpr int blocks = 27;
#ifdef __CUDA_ARCH__
        // A block's warps each ask for themselves: none waits for another.
        const int lane = int(thread_of_block() % 32);
        const bool changed =
            lane < blocks && (reports.before[block + beside(reports, lane)] & any_changed) != 0;
        return __any_sync(~0U, int(changed)) != 0;
#else
        std::uint64_t said = 0;
        for (int n = 0; n < blocks; ++n) said |= reports.before[block + beside(reports, n)];
        return (said & any_changed) != 0;
#endif
    }
}

/// A thread of `block` says whether it was stepped and whether its particle changed. All threads of a warp do
/// together; on the host, which has none, threads add to what was said before.
template <class Terms>
VOXSPRING_HOST_DEVICE void report(const BlockReports& reports, int block, bool stepped, bool changed) {
    if constexpr (Terms::compiled(term_resting)) {
#ifdef __CUDA_ARCH__
        const unsigned thread = thread_of_block();
        const bool any = __any_sync(~0U, int(changed)) != 0;
        if (thread % 32 == 0)
            reinterpret_cast<std::uint8_t*>(reports.after + block)[thread / 32] =
                std::uint8_t((stepped ? warp_stepped : 0) | (any ? warp_changed : 0));
#else
        reports.after[block] |= (stepped ? any_stepped : 0) | (changed ? any_changed : 0);
#endif
    }
}

}  // namespace voxspring::cuda
