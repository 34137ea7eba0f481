// Neighbours are read from shared memory, which holds three slices of one tile of WIDTH x HEIGHT particles at
// a time (Tile).
#include "cuda/kernels/entry.h"
#include "cuda/kernels/implicit.h"

namespace voxspring::cuda {

extern __shared__ __align__(16) unsigned char shared_memory[];

KERNEL step(const __grid_constant__ ImplicitStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output) {
    AWAIT_STEP_BEFORE();
    auto& tile = *reinterpret_cast<Tile<Real, Terms::split, WIDTH, HEIGHT>*>(shared_memory);
    const int tx = int(threadIdx.x), ty = int(threadIdx.y);
    const int row = step.nx, slice = step.nx * step.ny;
    for_each_block<Terms>(step, [&](const BlockOrigin& origin) {
        const int x = origin.x + tx, y = origin.y + ty;
        const int index = step.first + x + row * y + slice * origin.z;
        const bool inside = x < step.nx && y < step.ny;
        Self<Real, Terms::split> self{};
        if (inside) self = tile.fill(tx, ty, index, row, slice, Reader<Real, Terms::split, Fetch>{high, low});
        __syncthreads();
        if (!inside) return false;
        return step_voxel<Terms>(step, index, self, output,
                                 TileNeighbours<Real, Terms::split, WIDTH, HEIGHT>{tile, tx, ty},
                                 GridCompliance<Real>{step.compliance, index, row, slice});
    });
}

}  // namespace voxspring::cuda
