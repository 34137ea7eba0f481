// The grid is read through shared memory: a block loads three slices of a tile with a frame of one particle,
// and steps the middle slice (Figure 4).
#include "backends/rest_policy.h"
#include "cuda/common/implicit.h"
#include "cuda/common/tuning.h"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_implicit_shared",
    .summary =
        "One thread per voxel, neighbours by grid offset and mask from a tile of three slices in shared "
        "memory.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = tuning({{"dependent_launch", dependent_launches},
                      {"block", {"64x4", "32x8", "32x4", "16x16"}},
                      {"registers", implicit_registers},
                      {"interior", implicit_interior},
                      {"launched", implicit_launched},
                      {"rest", implicit_rest}}),
    .make = make_tiled,
    .bytes = implicit_bytes,
    .refused_options = refused_rest,
});

}  // namespace
}  // namespace voxspring::cuda
