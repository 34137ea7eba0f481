// Blocks of an implicit kernel that rest.
//
// A step is a function of a block's particles and of those around it. Where the latest step changed no bit of
// them, the next one would change none either: it need not be taken (term_resting). What a step that is not
// taken would write stands there: x(t) and x(t - dt) of such a block are equal. So a step begins with a list
// of the blocks that are left, and its blocks of threads take these one after another.
#pragma once

#include "cuda/kernels/terms.h"
#include "cuda/kernels/words.h"

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

/// Whether `block` is to be stepped: it or one around it changed.
VOXSPRING_HOST_DEVICE inline bool is_lively(const BlockReports& reports, int block) {
    constexpr int blocks = 27;
    std::uint64_t said = 0;
    for (int n = 0; n < blocks; ++n) said |= reports.before[block + beside(reports, n)];
    return (said & any_changed) != 0;
}

/// A thread of `block`, which was stepped, says whether its particle changed. All threads of a warp do
/// together; on the host, which has none, threads add to what was said before.
template <class Terms>
VOXSPRING_HOST_DEVICE void report(const BlockReports& reports, int block, bool changed) {
    if constexpr (Terms::compiled(term_resting)) {
#ifdef __CUDA_ARCH__
        const unsigned thread = threadIdx.x + blockDim.x * (threadIdx.y + blockDim.y * threadIdx.z);
        const bool any = __any_sync(~0U, int(changed)) != 0;
        if (thread % 32 == 0)
            reinterpret_cast<std::uint8_t*>(reports.after + block)[thread / 32] =
                std::uint8_t(warp_stepped | (any ? warp_changed : 0));
#else
        reports.after[block] |= any_stepped | (changed ? any_changed : 0);
#endif
    }
}

/// The blocks that a step takes, listed on the device before it.
struct LivelyBlocks {
    const BlockOrigin* origins;
    const unsigned* count;
    unsigned* next_count;  ///< of the step after this one: zero once this one has run
    bool operator==(const LivelyBlocks&) const = default;
};

}  // namespace voxspring::cuda
