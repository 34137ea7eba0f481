#include "cuda/kernels/entry.h"
#include "cuda/kernels/implicit.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ ImplicitStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output) {
    const BlockOrigin origin = block_origin(step);
    const bool lively = is_lively<Terms>(step.reports, origin.report);
    bool changed = false;
    if (lively) {
        changed = step_from_memory<Terms>(step, origin.x + int(threadIdx.x), origin.y + int(threadIdx.y),
                                          origin.z + int(threadIdx.z),
                                          Reader<Real, Terms::split, Fetch>{high, low}, output);
    }
    report<Terms>(step.reports, origin.report, lively, changed);
}

}  // namespace voxspring::cuda
