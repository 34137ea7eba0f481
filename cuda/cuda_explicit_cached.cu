// Neighbour lists with a secondary list of stiffness and rest length; positions through the texture path.
#include "backends/registry.h"
#include "cuda/explicit.cuh"

namespace voxspring::cuda {
namespace {

constexpr Secondary secondary = Secondary::always;

const Registered entry({
    .name = "cuda_explicit_cached",
    .summary = "One thread a particle, neighbours, stiffness and rest length by list, positions through a "
               "texture object.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"block", explicit_blocks}, {"fetch", {"texture", "l1"}}, {"layout", list_layouts}},
    .make =
        [](const Options& options) {
            return options.tuning.at("fetch") == "texture" ? make_explicit<secondary, ThroughTexture>(options)
                                                           : make_explicit<secondary, ThroughL1>(options);
        },
    .bytes = explicit_bytes<secondary>,
});

}  // namespace
}  // namespace voxspring::cuda
