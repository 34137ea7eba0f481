// The grid in global memory, read through the texture path.
#include "backends/rest_policy.h"
#include "cuda/common/implicit.h"
#include "cuda/common/tuning.h"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_implicit_cached",
    .summary = "One thread per voxel, neighbours by grid offset and mask through a texture object.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = tuning({{"dependent_launch", dependent_launches},
                      {"block", implicit_blocks},
                      {"fetch", {"texture", "l1"}},
                      {"registers", implicit_registers},
                      {"interior", implicit_interior},
                      {"launched", implicit_launched},
                      {"rest", implicit_rest}}),
    .make = make_implicit,
    .bytes = implicit_bytes,
    .refused_options = refused_rest,
});

}  // namespace
}  // namespace voxspring::cuda
