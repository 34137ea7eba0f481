// The tensor copy engine (compute capability 9.0) fills the windows, several planes ahead.
#include "cuda/kernels/entry.h"
#include "cuda/kernels/march.h"
#include "cuda/kernels/ring.h"

namespace voxspring::cuda {

extern __shared__ __align__(128) unsigned char shared_memory[];

inline constexpr MarchShape shape = SHAPE;

KERNEL step(const __grid_constant__ MarchStep<Real> step, const __grid_constant__ TensorMap positions,
            const __grid_constant__ TensorMap previous_windows,
            const __grid_constant__ MarchOutput<Real> output) {
    const MarchItem item = step.items[blockIdx.x];
    const int thread = int(threadIdx.x);
    MarchRings<Real, shape> rings(shared_memory, step, positions, previous_windows, item);
    if ((item.full_stencils >> (thread / 32) & 1U) != 0) {
        march<Terms, shape, false, EQUAL_EDGES>(step, item, output, thread, rings);
    } else {
        march<Terms, shape, true, EQUAL_EDGES>(step, item, output, thread, rings);
    }
}

}  // namespace voxspring::cuda
