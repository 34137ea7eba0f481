// Neighbour lists in global memory, read past L1. Stiffness and rest length are stored per spring only where
// a scene needs them.
#include "cuda/common/explicit.h"
#include "cuda/common/tuning.h"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_explicit_device",
    .summary = "One thread per particle, neighbours by list from global memory past L1.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = tuning({{"dependent_launch", dependent_launches},
                      {"block", explicit_blocks},
                      {"fetch", {"cg", "l1"}},
                      {"layout", list_layouts}}),
    .make = [](const Options& options) { return make_explicit(options, Secondary::where_needed); },
    .bytes = [](const Problem& problem,
                const Options& options) { return explicit_bytes(problem, options, Secondary::where_needed); },
});

}  // namespace
}  // namespace voxspring::cuda
