// One thread a spring and atomic sums, then one thread a particle.
#include <algorithm>
#include <memory>

#include "backends/registry.h"
#include "cuda/measure.h"
#include "cuda/particles.cuh"
#include "cuda/work.h"

namespace voxspring::cuda {
namespace {

constexpr int most_threads = 512;

template <class Real>
__global__ void __launch_bounds__(most_threads) add_forces(const __grid_constant__ ScatterStep<Real> step,
                                                           const __grid_constant__ ThroughL1<Real> current) {
    scatter_spring(step, std::size_t(blockIdx.x) * blockDim.x + threadIdx.x, current);
}

template <class Real>
__global__ void __launch_bounds__(most_threads)
    move_particles(const __grid_constant__ ScatterStep<Real> step,
                   const __grid_constant__ ThroughL1<Real> current, Word<Real>* previous) {
    integrate(step, int(blockIdx.x * blockDim.x + threadIdx.x), current, previous);
}

// Axes of the force array begin on a cache line.
std::size_t force_pitch(const Problem& problem) { return (problem.particle_count() + 31) / 32 * 32; }

template <class Real>
std::uint64_t scatter_bytes(const Problem& problem) {
    return particle_bytes<Real>(problem, problem.particle_count()) + 3 * force_pitch(problem) * sizeof(Real) +
           count_springs(problem).total() * (sizeof(SpringEnds) + sizeof(SpringConstants<Real>));
}

template <class Real>
class ScatterBackend final : public ParticleBackend<Real, ThroughL1<Real>, ScatterStep<Real>> {
public:
    explicit ScatterBackend(unsigned block) : block_(block) {}

    Capabilities capabilities() const override {
        Capabilities capabilities = CudaBackend::capabilities();
        capabilities.deterministic = false;  // atomics add in any order
        return capabilities;
    }

    void upload(const Problem& problem, const State& state) override {
        this->synchronize();
        const SpringArrays<Real> springs = list_every_spring<Real>(problem);
        slots_ = SpringSlots(problem, springs.begin);
        ends_.upload(springs.ends, this->stream());
        constants_.upload(springs.constants, this->stream());
        measure_rest_lengths(constants_, this->stream());
        force_.resize(3 * force_pitch(problem));
        force_.fill_with_zeros(this->stream());

        typename ScatterBackend::Launch launch;
        launch.kernel = move_particles<Real>;
        launch.block = dim3(block_);
        launch.grid = dim3(blocks_for(problem.particle_count(), block_));
        launch.step = {.particles = int(problem.particle_count()),
                       .springs = springs.ends.size(),
                       .ends = ends_.data(),
                       .constants = constants_.data(),
                       .force = force_.data(),
                       .pitch = force_pitch(problem),
                       .motion = make_motion<Real>(problem)};
        load_kernel(add_forces<Real>);
        this->start(problem, state, place_compact(problem), state_bits(problem), launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->follow(edited);
        const std::vector<EditedSpring<Real>> springs = slots_.slots_of<Real>(edit);
        if (slots_.used() > ends_.size()) {
            // Room for as many again and some more, empty until it is needed.
            const std::size_t size = slots_.used() + std::max<std::size_t>(slots_.used() / 8, 1024);
            ends_.grow(size, this->stream());
            constants_.grow(size, this->stream());
            typename ScatterBackend::Launch launch = this->launch();
            launch.step.springs = size;
            launch.step.ends = ends_.data();
            launch.step.constants = constants_.data();
            this->replay(launch);
        }
        write_springs(edited_springs_.send(std::span<const EditedSpring<Real>>(springs), this->stream()),
                      springs.size(), ends_.data(), constants_.data(), this->stream());
    }

    StepWork step_work(const Problem& problem) const override { return scatter_work<Real>(problem); }

private:
    std::string refused(const Problem& problem) const override {
        return too_many_words<ThroughL1<Real>>(problem.particle_count(), this->device());
    }
    std::uint64_t bytes_needed(const Problem& problem) const override { return scatter_bytes<Real>(problem); }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + ends_.bytes() + constants_.bytes() + force_.bytes() +
               edited_springs_.bytes();
    }

    void enqueue_step(int reading) override {
        const ScatterStep<Real>& step = this->launch().step;
        if (step.springs > 0)
            launch_kernel(this->stream(), add_forces<Real>, dim3(blocks_for(step.springs, block_)),
                          dim3(block_), step, this->reader(reading));
        ParticleBackend<Real, ThroughL1<Real>, ScatterStep<Real>>::enqueue_step(reading);
    }

    unsigned block_;
    SpringSlots slots_;
    Staging<EditedSpring<Real>> edited_springs_;
    Buffer<SpringEnds> ends_;
    Buffer<SpringConstants<Real>> constants_;
    Buffer<Real> force_;
};

const Registered entry({
    .name = "cuda_scatter",
    .summary = "One thread a spring, which adds its force to both particles with atomics.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"block", {"256", "64", "128", "512"}}},
    .make = [](const Options& options) -> std::unique_ptr<Backend> {
        const auto block = unsigned(std::stoul(options.tuning.at("block")));
        if (options.precision == Precision::float32) return std::make_unique<ScatterBackend<float>>(block);
        return std::make_unique<ScatterBackend<double>>(block);
    },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return options.precision == Precision::float32 ? scatter_bytes<float>(problem)
                                                           : scatter_bytes<double>(problem);
        },
});

}  // namespace
}  // namespace voxspring::cuda
