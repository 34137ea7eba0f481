// One launch for many steps: a block keeps its particles in registers, and what their springs reach in shared
// memory; points at borders travel through L2 (exchange.h). The tables are built by
// backends/layout/resident_layout.h.
#pragma once

#include "backends/layout/records/resident.h"
#include "cuda/kernels/exchange.h"
#include "cuda/kernels/implicit.h"

namespace voxspring::cuda {

/// Directions across which a warp's neighbours are other blocks': those with dy == 1 if `y`, and those with
/// dz == 1 if `z`.
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
