// With FORCES this is the kernel that adds up forces, with one thread per spring. Otherwise it is the one
// that moves particles.
#include "cuda/kernels/entry.h"
#include "cuda/kernels/scatter.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ ScatterStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output) {
    const std::size_t thread = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    const Reader<Real, Terms::split, Fetch> current{high, low};
#ifdef FORCES
    scatter_spring<Terms>(step, thread, current);
#else
    integrate<Terms>(step, int(thread), current, output);
#endif
}

}  // namespace voxspring::cuda
