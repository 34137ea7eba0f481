// The grid by way of shared memory: a block loads three slices of a tile with a frame of one particle, and
// steps the middle slice (Figure 4).
#include "backends/registry.h"
#include "cuda/implicit.cuh"

namespace voxspring::cuda {
namespace {

// The tile is the cache, so it is filled past L1.
template <class Real>
using Fetch = PastL1<Real>;

template <class Terms, Registers registers, class Real, int W, int H>
__global__ void __launch_bounds__(W* H, implicit_blocks_per_sm<Real, registers>)
    step_tile(const __grid_constant__ ImplicitStep<Real> step, const __grid_constant__ Fetch<Real> current,
              Word<Real>* previous) {
    __shared__ Tile<Real, W, H> tile;
    const BlockOrigin origin = block_origin(step);
    const int tx = int(threadIdx.x), ty = int(threadIdx.y);
    const int x = origin.x + tx, y = origin.y + ty;
    const int row = step.nx, slice = step.nx * step.ny;
    const int index = step.first + x + row * y + slice * origin.z;
    const bool inside = x < step.nx && y < step.ny;
    Particle<Real> self{};
    if (inside) self = tile.fill(tx, ty, index, row, slice, current);
    __syncthreads();
    if (!inside) return;
    step_voxel<Terms>(step, index, self, previous, TileNeighbours<Real, W, H>{tile, tx, ty},
                      GridCompliance<Real>{step.compliance, index, row, slice});
}

template <class Real, int W, int H>
struct FromTile {
    template <class Terms, Registers registers>
    static ImplicitKernel<Real, Fetch<Real>> get() {
        return step_tile<Terms, registers, Real, W, H>;
    }
};

template <class Real, int W, int H>
std::unique_ptr<Backend> make_tiled(const std::string& registers) {
    return std::make_unique<ImplicitBackend<Real, Fetch<Real>>>(BlockShape{W, H, 1}, registers,
                                                                choose_implicit_kernel<FromTile<Real, W, H>>);
}

template <class Real>
std::unique_ptr<Backend> make_shared_backend(const std::string& block, const std::string& registers) {
    if (block == "32x8") return make_tiled<Real, 32, 8>(registers);
    if (block == "32x4") return make_tiled<Real, 32, 4>(registers);
    if (block == "64x4") return make_tiled<Real, 64, 4>(registers);
    return make_tiled<Real, 16, 16>(registers);
}

const Registered entry({
    .name = "cuda_implicit_shared",
    .summary = "One thread a voxel, neighbours by grid offset and mask from a tile of three slices in shared "
               "memory.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"block", {"64x4", "32x8", "32x4", "16x16"}}, {"registers", implicit_registers}},
    .make =
        [](const Options& options) {
            const std::string& block = options.tuning.at("block");
            const std::string& registers = options.tuning.at("registers");
            return options.precision == Precision::float32 ? make_shared_backend<float>(block, registers)
                                                           : make_shared_backend<double>(block, registers);
        },
    .bytes = [](const Problem& problem, const Options& options) { return implicit_bytes(problem, options); },
});

}  // namespace
}  // namespace voxspring::cuda
