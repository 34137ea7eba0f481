// The argument of implicit addressing's kernels (cuda/kernels/implicit.h).
#pragma once

#include "backends/layout/records/motion.h"

namespace voxspring::layout {

/// Where a block of an implicit kernel starts, in voxels.
struct alignas(16) BlockOrigin {
    int x, y, z;
    /// Number of the block in the grid of blocks (BlockGrid of backends/layout/blocks.h).
    int place;
    bool operator==(const BlockOrigin&) const = default;
};

/// The blocks that are not at rest: this step takes the blocks in the list `now`, and fills the list `next`
/// for the next step. A block's place is its number in the grid of blocks. The grid has a frame around the
/// lattice, so that each block has 26 neighbouring places. A place without particles stays marked, so it is
/// never listed.
struct ActiveBlocks {
    int row, slice;          ///< places from a block to the next one along y, and along z
    const BlockOrigin* now;  ///< origins of the blocks to step, in any order
    BlockOrigin* next;       ///< the list for the next step, with room for all blocks
    /// Length of `now`. The step sets it to zero afterwards, since the next step fills this list anew.
    unsigned* now_count;
    unsigned* next_count;      ///< length of `next`; zero before the step
    std::uint32_t* now_marks;  ///< not 0 for each place that is listed in `now` or has no particles
    std::uint32_t* next_marks;
    /// How many thread blocks have read now_count; zero before and after a step.
    unsigned* readers;
    unsigned* taken;   ///< how many blocks the latest step took
    bool only_checks;  ///< the step fills `next` but stores no particle
    bool operator==(const ActiveBlocks&) const = default;
};

/// Everything a step needs besides positions. Grid arrays are x fastest, with guard words on either side:
/// voxel (x, y, z) is element first + x + nx (y + ny z), and the neighbours of any voxel, inside the lattice
/// or not, are elements that may be read.
template <class Real>
struct ImplicitStep {
    int nx, ny, nz;
    int first;
    /// Origins of the blocks that have an active voxel; null: blocks cover the whole lattice.
    const BlockOrigin* origins;
    std::uint32_t group_bits;
    Vector<Real> spacing;
    Real rest_length[13];    ///< for each pair of mask bits 2 b and 2 b + 1, as unit_pull() takes it
    Real deficit[13];        ///< RestSpring::deficit of each such pair
    Real stiffness[3];       ///< of each spring group, if there is one material
    const Real* compliance;  ///< 1 / stiffness of each voxel's material, if there are several
    Motion<Real> motion;
    ActiveBlocks active;  ///< for kernels that skip blocks at rest
    bool operator==(const ImplicitStep&) const = default;
};

}  // namespace voxspring::layout
