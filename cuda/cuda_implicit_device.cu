// The grid in global memory, read past L1.
#include "backends/registry.h"
#include "cuda/implicit.cuh"

namespace voxspring::cuda {
namespace {

const Registered entry({
    .name = "cuda_implicit_device",
    .summary = "One thread a voxel, neighbours by grid offset and mask from global memory past L1.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"block", implicit_blocks}, {"fetch", {"cg", "l1"}}, {"registers", implicit_registers}},
    .make =
        [](const Options& options) {
            return options.tuning.at("fetch") == "cg" ? make_implicit<PastL1>(options)
                                                      : make_implicit<ThroughL1>(options);
        },
    .bytes = [](const Problem& problem, const Options& options) { return implicit_bytes(problem, options); },
});

}  // namespace
}  // namespace voxspring::cuda
