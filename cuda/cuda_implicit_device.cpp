// The grid in global memory, read past L1.
#include "backends/rest_policy.h"
#include "cuda/common/implicit.h"
#include "cuda/common/tuning.h"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_implicit_device",
    .summary = "One thread per voxel, neighbours by grid offset and mask from global memory past L1.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = tuning({{"dependent_launch", dependent_launches},
                      {"block", implicit_blocks},
                      {"fetch", {"cg", "l1"}},
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
