// The grid in global memory, read through the texture path.
#include "backends/registry.h"
#include "cuda/implicit.cuh"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_implicit_cached",
    .summary = "One thread a voxel, neighbours by grid offset and mask through a texture object.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"block", implicit_blocks}, {"fetch", {"texture", "l1"}}, {"registers", implicit_registers}},
    .make =
        [](const Options& options) {
            return options.tuning.at("fetch") == "texture" ? make_implicit<ThroughTexture>(options)
                                                           : make_implicit<ThroughL1>(options);
        },
    .bytes = [](const Problem& problem, const Options& options) { return implicit_bytes(problem, options); },
});

}  // namespace
}  // namespace voxspring::cuda
