#include "cuda/kernels/delta.h"
#include "cuda/kernels/entry.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ DeltaStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output AND_BLOCKS) {
    AWAIT_STEP_BEFORE();
    const Reader<Real, Terms::split, Fetch> current{high, low};
    step_by_deltas<Terms>(step, int(BLOCK_NUMBER * blockDim.x + threadIdx.x), current, output);
}

}  // namespace voxspring::cuda
