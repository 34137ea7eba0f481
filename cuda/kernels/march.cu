// Windows, each of which holds one plane of a tile in shared memory, are filled one or more planes ahead: by
// the tensor copy engine (from compute capability 9.0 on) or, with ASYNC_COPIES, by the block's threads (from
// 8.0 on).
#include "cuda/kernels/entry.h"
#ifdef ASYNC_COPIES
#include "cuda/kernels/async_ring.h"
#else
#include "cuda/kernels/ring.h"
#endif

namespace voxspring::cuda {

extern __shared__ __align__(128) unsigned char shared_memory[];

inline constexpr MarchShape shape = SHAPE;

#ifdef ASYNC_COPIES
KERNEL step(const __grid_constant__ MarchStep<Real> step, const __grid_constant__ MarchArrays<Real> from,
            const __grid_constant__ MarchOutput<Real> output) {
    const MarchItem item = step.items[blockIdx.x];
    const int thread = int(threadIdx.x);
    AsyncRings<Real, shape> rings(shared_memory, step, from, item, thread);
#else
KERNEL step(const __grid_constant__ MarchStep<Real> step, const __grid_constant__ TensorMap positions,
            const __grid_constant__ TensorMap previous_windows,
            const __grid_constant__ MarchOutput<Real> output) {
    const MarchItem item = step.items[blockIdx.x];
    const int thread = int(threadIdx.x);
    MarchRings<Real, shape, KEPT_PLANES> rings(shared_memory, step, positions, previous_windows, item);
#endif
    if ((item.full_stencils >> (thread / 32) & 1U) != 0) {
        march<Terms, shape, false, EQUAL_EDGES>(step, item, output, thread, rings);
    } else {
        march<Terms, shape, true, EQUAL_EDGES>(step, item, output, thread, rings);
    }
}

}  // namespace voxspring::cuda
