// Implicit addressing on the device: the kernel that fetches neighbours from memory, and the backend that it
// shares with the one that fetches them from a tile.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "cuda/measure.h"
#include "cuda/particles.cuh"
#include "cuda/work.h"

namespace voxspring::cuda {

inline constexpr int most_implicit_threads = 256;

/// What a kernel is compiled for. On a small lattice, whose threads all run at once, a step takes as long as
/// one thread waits for memory: it gets the registers to fetch all neighbours of a group at once. On a large
/// one other threads run meanwhile, and few registers make room for more of them.
enum class Registers : std::uint8_t { many, few };
/// Threads that an SM of the architecture being compiled for holds (CUDA programming guide, compute
/// capabilities).
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ == 750
inline constexpr int threads_per_sm = 1024;
#elif defined(__CUDA_ARCH__) && (__CUDA_ARCH__ == 860 || __CUDA_ARCH__ == 870 || __CUDA_ARCH__ == 890)
inline constexpr int threads_per_sm = 1536;
#else
inline constexpr int threads_per_sm = 2048;
#endif
/// Blocks of most_implicit_threads that an SM has to have room for: in float32 with 64 registers a thread, or
/// as many as it can hold, with 32 on most. Twice the registers in float64.
template <class Real, Registers registers>
inline constexpr int implicit_blocks_per_sm = (registers == Registers::many
                                                   ? 4
                                                   : threads_per_sm / most_implicit_threads) /
                                              int(sizeof(Real) / sizeof(float));

/// Voxel that a block begins at.
template <class Real>
__device__ BlockOrigin block_origin(const ImplicitStep<Real>& step) {
    if (step.origins != nullptr) return step.origins[blockIdx.x];
    return {int(blockIdx.x * blockDim.x), int(blockIdx.y * blockDim.y), int(blockIdx.z * blockDim.z), 0};
}

template <class Terms, Registers registers, class Real, class Fetch>
__global__ void __launch_bounds__(most_implicit_threads, implicit_blocks_per_sm<Real, registers>)
    step_implicit(const __grid_constant__ ImplicitStep<Real> step, const __grid_constant__ Fetch current,
                  Word<Real>* previous) {
    const BlockOrigin origin = block_origin(step);
    step_from_memory<Terms>(step, origin.x + int(threadIdx.x), origin.y + int(threadIdx.y),
                            origin.z + int(threadIdx.z), current, previous);
}

template <class Real, class Fetch>
using ImplicitKernel = void (*)(ImplicitStep<Real>, Fetch, Word<Real>*);

template <class Kernels, Registers registers>
auto choose_implicit_kernel(const Problem& problem) {
    const bool face_and_edge = problem.group_bits == (FACE_BITS | EDGE_BITS);
    if (problem.has_materials())
        return face_and_edge ? Kernels::template get<ImplicitTerms<true, true>, registers>()
                             : Kernels::template get<ImplicitTerms<true, false>, registers>();
    return face_and_edge ? Kernels::template get<ImplicitTerms<false, true>, registers>()
                         : Kernels::template get<ImplicitTerms<false, false>, registers>();
}

/// The kernel for a scene: Kernels::get<Terms, registers>() is the one of these.
template <class Kernels>
auto choose_implicit_kernel(const Problem& problem, Registers registers) {
    return registers == Registers::many ? choose_implicit_kernel<Kernels, Registers::many>(problem)
                                        : choose_implicit_kernel<Kernels, Registers::few>(problem);
}

/// step_implicit as choose_implicit_kernel() wants it.
template <class Real, class Fetch>
struct FromMemory {
    template <class Terms, Registers registers>
    static ImplicitKernel<Real, Fetch> get() {
        return step_implicit<Terms, registers, Real, Fetch>;
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
    using Choose = ImplicitKernel<Real, Fetch> (*)(const Problem&, Registers);

    /// `shape`: threads of a block, one a voxel. `registers`: "many", "few" or, by the lattice's size,
    /// "auto".
    ImplicitBackend(BlockShape shape, std::string registers, Choose choose)
        : shape_(shape), registers_(std::move(registers)), choose_(choose) {}

    void upload(const Problem& problem, const State& state) override {
        this->synchronize();
        const Lattice& lattice = problem.lattice;
        const Placement placement = place_on_grid(lattice);
        const std::vector<BlockOrigin> origins = active_blocks(lattice, shape_);
        origins_.upload(origins, this->stream());
        compliance_.upload(pack_compliance<Real>(problem, placement), this->stream());

        typename ImplicitBackend::Launch launch;
        launch.block = dim3(unsigned(shape_.x), unsigned(shape_.y), unsigned(shape_.z));
        launch.grid = !origins.empty() ? dim3(unsigned(origins.size()))
                                       : dim3(blocks_for(std::size_t(lattice.dims.x), launch.block.x),
                                              blocks_for(std::size_t(lattice.dims.y), launch.block.y),
                                              blocks_for(std::size_t(lattice.dims.z), launch.block.z));
        launch.kernel = choose_(problem, registers_for(launch.grid));
        launch.step = make_implicit_step<Real>(problem, placement);
        launch.step.origins = origins_.data();
        launch.step.compliance = compliance_.data();
        measure_rest_lengths<Real>(launch.step.rest_length, this->stream());
        this->start(problem, state, placement, lattice.mask, launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->follow(edited);
        std::vector<std::uint32_t> particles, masks;
        for (const SpringEdit::Touched& touched : edit.touched) {
            particles.push_back(touched.particle);
            masks.push_back(touched.mask);
        }
        this->write_particle_bits(particles, masks);
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

    Registers registers_for(dim3 grid) const {
        if (registers_ != "auto") return registers_ == "many" ? Registers::many : Registers::few;
        const std::size_t threads =
            std::size_t(grid.x) * grid.y * grid.z * std::size_t(shape_.x * shape_.y * shape_.z);
        const int at_once = this->device().multiprocessors() * most_implicit_threads *
                            implicit_blocks_per_sm<Real, Registers::many>;
        return threads <= std::size_t(at_once) ? Registers::many : Registers::few;
    }

    BlockShape shape_;
    std::string registers_;
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
    const std::string& registers = options.tuning.at("registers");
    if (options.precision == Precision::float32)
        return std::make_unique<ImplicitBackend<float, Fetch<float>>>(
            shape, registers, choose_implicit_kernel<FromMemory<float, Fetch<float>>>);
    return std::make_unique<ImplicitBackend<double, Fetch<double>>>(
        shape, registers, choose_implicit_kernel<FromMemory<double, Fetch<double>>>);
}

/// Shapes of at most most_implicit_threads, the default first.
inline const TuningValues implicit_blocks = {"32x4x2",  "32x8x1", "64x4x1", "128x2x1",
                                             "128x1x1", "16x4x4", "8x8x4"};

/// As ImplicitBackend takes them.
inline const TuningValues implicit_registers = {"auto", "many", "few"};

}  // namespace voxspring::cuda
