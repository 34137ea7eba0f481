// Implicit addressing on the device: the kernel that fetches neighbours from memory, and the backend that it
// shares with the one that fetches them from a tile.
#pragma once

#include <memory>

#include "cuda/measure.h"
#include "cuda/particles.cuh"
#include "cuda/work.h"

namespace voxspring::cuda {

inline constexpr int most_implicit_threads = 256;
/// Blocks of that size an SM has to have room for: with 4 in float32, 64 registers a thread, room for the
/// fetches of a group at once.
template <class Real>
inline constexpr int implicit_blocks_per_sm = sizeof(Real) == sizeof(float) ? 4 : 2;

/// Voxel that a block begins at.
template <class Real>
__device__ BlockOrigin block_origin(const ImplicitStep<Real>& step) {
    if (step.origins != nullptr) return step.origins[blockIdx.x];
    return {int(blockIdx.x * blockDim.x), int(blockIdx.y * blockDim.y), int(blockIdx.z * blockDim.z), 0};
}

template <class Terms, class Real, class Fetch>
__global__ void __launch_bounds__(most_implicit_threads, implicit_blocks_per_sm<Real>)
    step_implicit(const __grid_constant__ ImplicitStep<Real> step, const __grid_constant__ Fetch current,
                  Word<Real>* previous) {
    const BlockOrigin origin = block_origin(step);
    step_from_memory<Terms>(step, origin.x + int(threadIdx.x), origin.y + int(threadIdx.y),
                            origin.z + int(threadIdx.z), current, previous);
}

template <class Real, class Fetch>
using ImplicitKernel = void (*)(ImplicitStep<Real>, Fetch, Word<Real>*);

/// The kernel for a scene: Kernels::get<Terms>() is the one of `Terms`.
template <class Kernels>
auto choose_implicit_kernel(const Problem& problem) {
    const bool face_and_edge = problem.group_bits == (FACE_BITS | EDGE_BITS);
    if (problem.has_materials())
        return face_and_edge ? Kernels::template get<ImplicitTerms<true, true>>()
                             : Kernels::template get<ImplicitTerms<true, false>>();
    return face_and_edge ? Kernels::template get<ImplicitTerms<false, true>>()
                         : Kernels::template get<ImplicitTerms<false, false>>();
}

/// step_implicit as choose_implicit_kernel() wants it.
template <class Real, class Fetch>
struct FromMemory {
    template <class Terms>
    static ImplicitKernel<Real, Fetch> get() {
        return step_implicit<Terms, Real, Fetch>;
    }
};

/// Bytes of device memory.
template <class Real>
std::uint64_t implicit_bytes(const Problem& problem, BlockShape shape) {
    const std::size_t words = place_on_grid(problem.lattice).words;
    return particle_bytes<Real>(problem, words) + (problem.has_materials() ? words * sizeof(Real) : 0) +
           active_blocks(problem.lattice, shape).size() * sizeof(BlockOrigin);
}

template <class Real, class Fetch>
class ImplicitBackend final : public ParticleBackend<Real, Fetch, ImplicitStep<Real>> {
public:
    using Choose = ImplicitKernel<Real, Fetch> (*)(const Problem&);

    /// `shape`: threads of a block, one a voxel.
    ImplicitBackend(BlockShape shape, Choose choose) : shape_(shape), choose_(choose) {}

    void upload(const Problem& problem, const State& state) override {
        this->synchronize();
        const Lattice& lattice = problem.lattice;
        const Placement placement = place_on_grid(lattice);
        const std::vector<BlockOrigin> origins = active_blocks(lattice, shape_);
        origins_.upload(origins, this->stream());
        compliance_.upload(pack_compliance<Real>(problem, placement), this->stream());

        typename ImplicitBackend::Launch launch;
        launch.kernel = choose_(problem);
        launch.block = dim3(unsigned(shape_.x), unsigned(shape_.y), unsigned(shape_.z));
        launch.grid = !origins.empty() ? dim3(unsigned(origins.size()))
                                       : dim3(blocks_for(std::size_t(lattice.dims.x), launch.block.x),
                                              blocks_for(std::size_t(lattice.dims.y), launch.block.y),
                                              blocks_for(std::size_t(lattice.dims.z), launch.block.z));
        launch.step = make_implicit_step<Real>(problem, placement);
        launch.step.origins = origins_.data();
        launch.step.compliance = compliance_.data();
        measure_rest_lengths<Real>(launch.step.rest_length, this->stream());
        this->start(problem, state, placement, lattice.mask, launch);
    }

    StepWork step_work(const Problem& problem) const override { return implicit_work<Real>(problem); }

private:
    std::string refused(const Problem& problem) const override {
        if (problem.lattice.voxel_count() == 0)
            return "implicit addressing needs a regular grid and the network lies on none";
        if (!problem.springs.empty())
            return "implicit addressing has no place for springs between particles that are no grid "
                   "neighbours";
        return too_many_words<Fetch>(place_on_grid(problem.lattice).words, this->device());
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return implicit_bytes<Real>(problem, shape_);
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + origins_.bytes() + compliance_.bytes();
    }

    BlockShape shape_;
    Choose choose_;
    Buffer<BlockOrigin> origins_;
    Buffer<Real> compliance_;
};

inline std::uint64_t implicit_bytes(const Problem& problem, const Options& options) {
    const BlockShape shape = BlockShape::parse(options.tuning.at("block"));
    return options.precision == Precision::float32 ? implicit_bytes<float>(problem, shape)
                                                   : implicit_bytes<double>(problem, shape);
}

/// The backend that fetches neighbours through `Fetch`.
template <template <class> class Fetch>
std::unique_ptr<Backend> make_implicit(const Options& options) {
    const BlockShape shape = BlockShape::parse(options.tuning.at("block"));
    if (options.precision == Precision::float32)
        return std::make_unique<ImplicitBackend<float, Fetch<float>>>(
            shape, choose_implicit_kernel<FromMemory<float, Fetch<float>>>);
    return std::make_unique<ImplicitBackend<double, Fetch<double>>>(
        shape, choose_implicit_kernel<FromMemory<double, Fetch<double>>>);
}

/// Shapes of at most most_implicit_threads, the default first.
inline const TuningValues implicit_blocks = {"32x4x2",  "32x8x1", "64x4x1", "128x2x1",
                                             "128x1x1", "16x4x4", "8x8x4"};

}  // namespace voxspring::cuda
