// The argument of implicit addressing's kernels (cuda/kernels/implicit.h).
#pragma once

#include "backends/layout/records/motion.h"

namespace voxspring::layout {

/// Where a block of an implicit kernel starts, in voxels.
struct alignas(16) BlockOrigin {
    int x, y, z;
    int place;  ///< of the block (BlockGrid of backends/layout/blocks.h)
    bool operator==(const BlockOrigin&) const = default;
};

/// The active blocks: those that this step takes, and those that the next step will take. Marks have a frame
/// of places around those of the lattice, so each block has 26 neighbours. A place without particles stays
/// marked.
struct ActiveBlocks {
    int row, slice;            ///< from a block's place to the next one's along y and z
    const BlockOrigin* now;    ///< origins of the blocks to step, in any order
    BlockOrigin* next;         ///< room for all blocks
    unsigned* now_count;       ///< zero after the step, whose list becomes that of the step after the next
    unsigned* next_count;      ///< zero before the step
    std::uint32_t* now_marks;  ///< for each place whether it is listed or has no particles
    std::uint32_t* next_marks;
    unsigned* readers;  ///< blocks of threads that have read now_count; zero before and after
    unsigned* taken;    ///< blocks that the latest step took
    bool only_checks;   ///< the step stores only the next list, and nothing of the particles
    bool operator==(const ActiveBlocks&) const = default;
};

/// Everything a step needs besides positions. Grid arrays are x fastest, with guard words on either side:
/// voxel (x, y, z) is element first + x + nx (y + ny z), and the neighbours of any voxel, inside the lattice
/// or not, are elements that may be read.
template <class Real>
struct ImplicitStep {
    int nx, ny, nz;
    int first;
    const BlockOrigin* origins;  ///< of the blocks with an active voxel; null: blocks cover the lattice
    std::uint32_t group_bits;
    Vector<Real> spacing;
    Real rest_length[13];    ///< of mask bits 2 b and 2 b + 1, as unit_pull() takes it
    Real deficit[13];        ///< likewise: RestSpring::deficit
    Real stiffness[3];       ///< of each spring group, if there is one material
    const Real* compliance;  ///< 1 / stiffness of each voxel's material, if there are several
    Motion<Real> motion;
    ActiveBlocks active;  ///< for kernels that skip blocks at rest
    bool operator==(const ImplicitStep&) const = default;
};

}  // namespace voxspring::layout
