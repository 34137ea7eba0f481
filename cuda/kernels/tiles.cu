// One thread per active tile. Steps sweep the list forth and back in turn: a step begins with what the step
// before has left in L2.
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
    const std::uint32_t tile = group_tiles + block * THREADS + threadIdx.x;
    const TileRows rows(step.rows, tile);  // which no step or edit writes
    AWAIT_STEP_BEFORE();
    step_tile<Terms, EQUAL_EDGES>(step, rows, at, output, tile);
}

}  // namespace voxspring::cuda
