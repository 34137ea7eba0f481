// Neighbour lists of a regular grid, with one counter per spring group instead of a secondary list. Positions
// are read through the texture path.
#include "cuda/common/explicit.h"
#include "cuda/common/tuning.h"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_explicit_cached_grid",
    .summary =
        "One thread per particle, neighbours by list with one counter per spring group, positions through a "
        "texture object.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = tuning({{"dependent_launch", dependent_launches},
                      {"block", explicit_blocks},
                      {"fetch", {"texture", "l1"}},
                      {"layout", list_layouts}}),
    .make = [](const Options& options) { return make_explicit(options, Secondary::never); },
    .bytes = [](const Problem& problem,
                const Options& options) { return explicit_bytes(problem, options, Secondary::never); },
});

}  // namespace
}  // namespace voxspring::cuda
