// The argument of the kernels with implicit addressing, which find neighbours by their place in the lattice
// (cuda/kernels/implicit.h).
#pragma once

#include "backends/layout/records/motion.h"

namespace voxspring::layout {

/// Where a block of an implicit kernel starts, in voxels.
struct alignas(16) BlockOrigin {
    int x, y, z;
    /// Number of the block in the grid of blocks, which has a frame around the lattice (BlockGrid of
    /// backends/layout/blocks.h).
    int place;
    bool operator==(const BlockOrigin&) const = default;
};

/// The blocks that may not be at rest, if blocks at rest are skipped: a step takes the blocks in the list
/// `now`, and fills the list `next` for the next step. The place of a block is its number in the grid of
/// blocks. This grid has a frame of blocks around the lattice, so that each block has 26 neighbouring places.
/// A place without particles stays marked, so it is never listed.
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
    unsigned* taken;   ///< how many blocks the latest step has stepped
    bool only_checks;  ///< the launch fills `next` but moves no particle
    bool operator==(const ActiveBlocks&) const = default;
};

/// Everything a step needs besides the particles' state. An array over the grid has guard words before and
/// after it: voxel (x, y, z) is element first + x + nx (y + ny z), and each of its 26 neighbours is an
/// element that may be read, even if it lies outside of the lattice.
template <class Real>
struct ImplicitStep {
    int nx, ny, nz;
    int first;
    /// Origins of the blocks to step, each with an active voxel; null: blocks cover the whole lattice.
    const BlockOrigin* origins;
    std::uint32_t group_bits;
    Vector<Real> spacing;
    Real rest_length[13];    ///< element b: for mask bits 2 b and 2 b + 1; as in SpringConstants
    Real deficit[13];        ///< element b: RestSpring::deficit for mask bits 2 b and 2 b + 1
    Real stiffness[3];       ///< of each spring group, if there is one material
    const Real* compliance;  ///< if there are several materials: 1 / stiffness per word
    Motion<Real> motion;
    ActiveBlocks active;  ///< for kernels that skip blocks at rest
    bool operator==(const ImplicitStep&) const = default;
};

}  // namespace voxspring::layout
