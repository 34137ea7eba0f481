// One launch takes many steps. A block keeps its particles in registers, unless a thread has several, and the
// points that their springs reach in shared memory. Points at a block's border travel through L2 or, to
// another part of the body, into the memory of its device (exchange.h). backends/layout/resident_layout.h
// builds the tables.
#pragma once

#include "backends/layout/records/resident.h"
#include "cuda/kernels/exchange.h"
#include "cuda/kernels/implicit.h"

namespace voxspring::cuda {

/// The directions in which a warp's neighbours belong to other blocks: those with dy == 1 if `y`, and those
/// with dz == 1 if `z`. has() tells whether a direction is one of them.
template <bool y, bool z>
struct Across {
    static VOXSPRING_HOST_DEVICE constexpr bool has(int, int dy, int dz) {
        return (y && dy == 1) || (z && dz == 1);
    }
};
template <class Directions>
struct Except {
    static VOXSPRING_HOST_DEVICE constexpr bool has(int dx, int dy, int dz) {
        return !Directions::has(dx, dy, dz);
    }
};

}  // namespace voxspring::cuda
