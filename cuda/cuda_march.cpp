// The grid plane by plane: blocks march along z over tiles of columns, positions in structure of arrays,
// windows filled by the tensor copy engine.
#include "cuda/common/march.h"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_march",
    .summary = "Blocks march along z, two to four columns a thread, planes copied ahead into shared memory; "
               "one material, face and edge springs.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement},
    .tuning = {{"tile", march_tiles}},
    .make = make_march,
    .bytes = march_bytes,
});

}  // namespace
}  // namespace voxspring::cuda
