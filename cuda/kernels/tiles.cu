// Each active tile has TILE_THREADS threads, which are in as many successive warps. Successive steps that are
// not split go through the list of tiles forwards and backwards in turn, so that a step begins with the tiles
// that the previous step has left in L2.
#include "cuda/kernels/entry.h"
#include "cuda/kernels/tiles.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ TileStep<Real> step, const Real* at,
            const __grid_constant__ MarchOutput<Real> output, bool backwards AND_BLOCKS) {
#ifdef LISTED_BLOCKS
    const unsigned block = BLOCK_NUMBER;
#else
    const unsigned block = backwards ? gridDim.x - 1 - blockIdx.x : blockIdx.x;
#endif
    const unsigned warp = threadIdx.x / group_tiles;
    const std::uint32_t tile = group_tiles + block * (THREADS / TILE_THREADS) +
                               warp / TILE_THREADS * group_tiles + threadIdx.x % group_tiles;
    const TileRows rows(step.rows, tile);  // read before AWAIT_STEP_BEFORE(): no step or edit writes the rows
    AWAIT_STEP_BEFORE();
    step_tile<Terms, EQUAL_EDGES, TILE_THREADS>(step, rows, at, output, tile, warp % TILE_THREADS);
}

}  // namespace voxspring::cuda
