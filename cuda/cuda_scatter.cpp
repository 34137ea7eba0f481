// One thread per spring with atomic sums, then one thread per particle.
#include <algorithm>
#include <memory>

#include "backends/by_precision.h"
#include "backends/layout/spring_array.h"
#include "backends/layout/springs.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/particles.h"

namespace voxspring::cuda {
namespace {

constexpr int max_threads = 512;

// Elements from one axis of the force array to the next. Each axis begins on a cache line.
std::size_t force_pitch(const Problem& problem) { return (problem.particle_count() + 31) / 32 * 32; }

template <class Real>
std::uint64_t scatter_bytes(const Problem& problem, Formulation formulation) {
    const bool off_lattice_rest = !problem.springs.empty() && !on_positions(formulation);
    return particle_bytes<Real>(problem, place_compact(problem), formulation) +
           3 * force_pitch(problem) * sizeof(Real) +
           count_springs(problem).total() * (sizeof(SpringEnds) + sizeof(SpringConstants<Real>) +
                                             (off_lattice_rest ? sizeof(SpringRest<Real>) : 0));
}

template <class Real>
class ScatterBackend final : public ParticleBackend<Real, ScatterStep<Real>> {
public:
    explicit ScatterBackend(const Options& options)
        : ParticleBackend<Real, ScatterStep<Real>>(KernelFamily(options, Fetch::through_l1)),
          block_(unsigned(std::stoul(options.tuning.at("block")))) {}

    Capabilities capabilities() const override {
        Capabilities capabilities = CudaBackend::capabilities();
        capabilities.deterministic = false;  // atomics add in any order
        return capabilities;
    }

    void upload(const Problem& problem, const State& state) override {
        this->template begin_upload<Real>();
        const SpringArrays<Real> springs = list_every_spring<Real>(problem, this->formulation());
        slots_ = SpringSlots(problem, springs.begin, this->formulation());
        ends_.upload(springs.ends, this->stream());
        constants_.upload(springs.constants, this->stream());
        off_lattice_rest_.upload(springs.off_lattice_rest, this->stream());
        if (!by_increments(this->formulation())) calibrate_rest_lengths(constants_, this->stream());
        force_.resize(3 * force_pitch(problem));
        force_.fill_with_zeros(this->stream());

        typename ScatterBackend::Launch launch;
        launch.block = dim3(block_);
        launch.grid = dim3(blocks_for(problem.particle_count(), block_));
        launch.step = make_scatter_step<Real>(problem, springs);
        launch.step.force = force_.data();
        launch.step.pitch = force_pitch(problem);
        point_at_springs(launch.step);
        choose_kernels(problem, launch);
        this->start(problem, state, place_compact(problem), state_bits(problem), launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        const std::vector<EditedSpring<Real>> springs = slots_.template slots_of<Real>(edit);
        // The kernels write and read this array for every slot once it exists, even if the springs that
        // needed it are cut.
        const bool has_rests =
            off_lattice_rest_.size() > 0 || (!edited.springs.empty() && !on_positions(this->formulation()));
        if (slots_.used() > ends_.size() || (has_rests && off_lattice_rest_.size() == 0)) {
            // Allocate spare room as well, which stays empty until a later edit needs it.
            const std::size_t size = slots_.used() + std::max<std::size_t>(slots_.used() / 8, 1024);
            ends_.grow(size, this->stream());
            constants_.grow(size, this->stream());
            if (has_rests) off_lattice_rest_.grow(size, this->stream());
            typename ScatterBackend::Launch launch = this->launch();
            launch.step.springs = size;
            point_at_springs(launch.step);
            choose_kernels(edited, launch);
            this->resume(launch);
        }
        launch_for_each(*support_kernels<Real>().write_springs, springs.size(), this->stream(),
                        edited_springs_.send(std::span<const EditedSpring<Real>>(springs), this->stream()),
                        springs.size(), ends_.data(), constants_.data(), off_lattice_rest_.data());
    }

    StepWork step_work(const Problem& problem) const override {
        return scatter_work<Real>(problem, this->formulation());
    }

private:
    std::string refused(const Problem& problem) const override {
        if (std::string why = list_entry_refusal(problem.particle_count(), this->formulation()); !why.empty())
            return why;
        return too_many_words<Real>(problem.particle_count(), this->device(), this->family().fetch);
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return scatter_bytes<Real>(problem, this->formulation());
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + ends_.bytes() + constants_.bytes() + off_lattice_rest_.bytes() +
               force_.bytes() + edited_springs_.bytes();
    }

    void point_at_springs(ScatterStep<Real>& step) const {
        step.ends = ends_.data();
        step.constants = constants_.data();
        step.off_lattice_rest = off_lattice_rest_.data();
    }

    void choose_kernels(const Problem& problem, typename ScatterBackend::Launch& launch) {
        KernelSource source = this->family().source(
            "scatter.cu", problem, max_threads, 1, off_lattice_rest_.size() > 0 ? term_off_lattice_rests : 0);
        launch.kernel = this->kernel(source);
        source.macros["FORCES"] = "1";
        add_forces_ = this->kernel(source);
    }

    void enqueue_step(int reading) override {
        const ScatterStep<Real>& step = this->launch().step;
        if (step.springs > 0)
            this->launch_kernel(this->stream(), *add_forces_, dim3(blocks_for(step.springs, block_)),
                                dim3(block_), 0, step, reading);
        ParticleBackend<Real, ScatterStep<Real>>::enqueue_step(reading);
    }

    const unsigned block_;
    std::shared_ptr<const Kernel> add_forces_;
    SpringSlots slots_;
    Staging<EditedSpring<Real>> edited_springs_;
    Buffer<SpringEnds> ends_;
    Buffer<SpringConstants<Real>> constants_;
    Buffer<SpringRest<Real>> off_lattice_rest_;
    Buffer<Real> force_;
};

const Registered entry({
    .name = "cuda_scatter",
    .api = "cuda",
    .summary = "One thread per spring, which adds its force to both particles with atomics.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = tuning({{"block", {"256", "64", "128", "512"}}}),
    .make = [](const Options& options) { return make_by_precision<ScatterBackend>(options, options); },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return by_precision(options.precision, [&]<class Real>(Real) {
                return scatter_bytes<Real>(problem, options.formulation);
            });
        },
});

}  // namespace
}  // namespace voxspring::cuda
