// With SHUFFLES, whole slices get neighbours of their rows from other lanes.
#include "cuda/kernels/delta.h"
#include "cuda/kernels/entry.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ DeltaStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output) {
    step_by_deltas<Terms>(step, int(blockIdx.x * blockDim.x + threadIdx.x),
                          Reader<Real, Terms::split, Fetch>{high, low}, output);
}

}  // namespace voxspring::cuda
