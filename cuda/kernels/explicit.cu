// With SECONDARY the step reads the secondary list, otherwise one counter per spring group. With ROWS it
// reads the paper's rows (ListRows).
#include "cuda/kernels/entry.h"
#include "cuda/kernels/explicit.h"

namespace voxspring::cuda {

KERNEL step(const __grid_constant__ ExplicitStep<Real> step, const __grid_constant__ Fetch high,
            const __grid_constant__ Fetch low, const __grid_constant__ Output<Real> output AND_BLOCKS) {
    AWAIT_STEP_BEFORE();
    const int i = int(BLOCK_NUMBER * blockDim.x + threadIdx.x);
    const Reader<Real, Terms::split, Fetch> current{high, low};
#if defined(ROWS) && defined(SECONDARY)
    step_by_rows<Terms, true>(step, i, current, output);
#elif defined(ROWS)
    step_by_rows<Terms, false>(step, i, current, output);
#elif defined(SECONDARY)
    step_by_springs<Terms>(step, i, current, output);
#else
    step_by_groups<Terms>(step, i, current, output);
#endif
}

}  // namespace voxspring::cuda
