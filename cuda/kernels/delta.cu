// With PAIRS a thread steps two particles.
#include "cuda/kernels/delta.h"
#include "cuda/kernels/entry.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ DeltaStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output) {
    const int thread = int(blockIdx.x * blockDim.x + threadIdx.x);
    const Reader<Real, Terms::split, Fetch> current{high, low};
#ifdef PAIRS
    step_two_by_deltas<Terms>(step, 2 * thread, current, output);
#else
    step_by_deltas<Terms>(step, thread, current, output);
#endif
}

}  // namespace voxspring::cuda
