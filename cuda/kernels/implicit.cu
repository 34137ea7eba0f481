#include "cuda/kernels/entry.h"
#include "cuda/kernels/implicit.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ ImplicitStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output) {
    AWAIT_STEP_BEFORE();
    for_each_block<Terms>(step, [&](const BlockOrigin& origin) {
        return step_from_memory<Terms>(step, origin.x + int(threadIdx.x), origin.y + int(threadIdx.y),
                                       origin.z + int(threadIdx.z),
                                       Reader<Real, Terms::split, Fetch>{high, low}, output);
    });
}

}  // namespace voxspring::cuda
