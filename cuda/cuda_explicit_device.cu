// Neighbour lists in global memory, read past L1; stiffness and rest length a spring only where a scene has
// them.
#include "backends/registry.h"
#include "cuda/explicit.cuh"

namespace voxspring::cuda {
namespace {

constexpr Secondary secondary = Secondary::where_needed;

const Registered entry({
    .name = "cuda_explicit_device",
    .summary = "One thread a particle, neighbours by list from global memory past L1.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"block", explicit_blocks}, {"fetch", {"cg", "l1"}}, {"layout", list_layouts}},
    .make =
        [](const Options& options) {
            return options.tuning.at("fetch") == "cg" ? make_explicit<secondary, PastL1>(options)
                                                      : make_explicit<secondary, ThroughL1>(options);
        },
    .bytes = explicit_bytes<secondary>,
});

}  // namespace
}  // namespace voxspring::cuda
