// Explicit addressing by delta-compressed neighbour lists, which runs of particles share (kernels/delta.h).
#include <memory>
#include <optional>

#include "backends/by_precision.h"
#include "backends/layout/delta_lists.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/particles.h"

namespace voxspring::cuda {
namespace {

constexpr int max_threads = 256;

/// How many columns to allocate for springs beyond the lattice (Problem::springs) if `used` columns are in
/// use: a quarter and 256 more, as room for edits. A column has one spring end for each of a slice's 32
/// particles.
std::size_t roomy(std::size_t used) { return used == 0 ? 0 : used + used / 4 + 256; }

template <class Real>
std::size_t column_bytes(Formulation formulation) {
    return slice_particles * (sizeof(std::uint32_t) + sizeof(SpringConstants<Real>) +
                              (on_positions(formulation) ? 0 : sizeof(SpringRest<Real>)));
}

template <class Real>
std::uint64_t delta_bytes(const Problem& problem, Formulation formulation) {
    const Placement placement = place_guarded(problem);
    DeltaLists lists = compress_lists(problem);
    const OffLatticeLists<Real> off_lattice(problem, placement, formulation, lists.slices);
    return particle_bytes<Real>(problem, placement, formulation) +
           (problem.has_materials() ? placement.words * sizeof(Real) : 0) +
           lists.slices.size() * sizeof(Slice) + lists.lists.size() * sizeof(RowDeltas) +
           roomy(off_lattice.columns()) * column_bytes<Real>(formulation);
}

/// An upper bound of delta_bytes(), computed without making the lists. It assumes that every particle begins
/// a list, and that every end of a spring beyond the lattice takes a chunk of columns.
template <class Real>
std::uint64_t max_delta_bytes(const Problem& problem, Formulation formulation) {
    const Placement placement = place_guarded(problem);
    const std::uint64_t particles = problem.particle_count();
    return particle_bytes<Real>(problem, placement, formulation) +
           (problem.has_materials() ? placement.words * sizeof(Real) : 0) +
           (particles / slice_particles + 1) * sizeof(Slice) + particles * sizeof(RowDeltas) +
           roomy(2 * problem.springs.size() * off_lattice_chunk) * column_bytes<Real>(formulation);
}

template <class Real>
class DeltaBackend final : public ParticleBackend<Real, DeltaStep<Real>> {
public:
    explicit DeltaBackend(const Options& options)
        : ParticleBackend<Real, DeltaStep<Real>>(KernelFamily(options, Fetch::through_l1)),
          options_(options),
          block_(unsigned(std::stoul(options.tuning.at("block")))),
          registers_(options.tuning.at("registers")),
          interior_(options.tuning.at("interior") == "vote") {}

    void upload(const Problem& problem, const State& state) override {
        this->template begin_upload<Real>();
        const Placement placement = place_guarded(problem);
        DeltaLists lists = compress_lists(problem);
        slices_ = std::move(lists.slices);
        lists_on_device_.upload(lists.lists, this->stream());
        compliance_.upload(pack_compliance<Real>(problem, placement), this->stream());

        typename DeltaBackend::Launch launch;
        launch.block = dim3(block_);
        launch.grid = dim3(blocks_for(problem.particle_count(), block_));
        launch.step = make_delta_step<Real>(problem, placement, this->formulation());
        launch.step.lists = lists_on_device_.data();
        launch.step.compliance = compliance_.data();
        if (!by_increments(this->formulation()))
            calibrate_rest_lengths<Real>(launch.step.rest_length, this->stream());
        lay_out_off_lattice(problem, launch);
        const std::vector<std::uint32_t> without_lattice =
            problem.lattice.mask.empty() ? state_bits(problem) : std::vector<std::uint32_t>{};
        this->start(problem, state, placement,
                    problem.lattice.mask.empty() ? without_lattice : problem.lattice.mask, launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        this->write_masks(edit);
        if (off_lattice_.empty() && edited.springs.empty()) return;
        const auto changes = off_lattice_.change(edited, edit, slices_);
        if (off_lattice_.columns() > neighbour_.size() / slice_particles) {
            this->synchronize();
            typename DeltaBackend::Launch launch = this->launch();
            lay_out_off_lattice(edited, launch);
            this->resume(launch);
            return;
        }
        const std::size_t columns = changes.columns.particle.size();
        write_rows(edited_columns_.send(changes.columns, !by_increments(this->formulation()), this->stream()),
                   columns, changes.columns.lists.shape, static_cast<ParticleRecord<Real>*>(nullptr),
                   neighbour_.data(), constants_.data(), off_lattice_rest_.data(), this->stream());
        launch_for_each(*support_kernels<Real>().write_slices, changes.slices.size(), this->stream(),
                        edited_slices_.send(std::span<const EditedSlice>(changes.slices), this->stream()),
                        changes.slices.size(), slices_on_device_.data());
    }

    std::optional<Choice> choice() const override {
        return choice_of_auto(options_, {{"dependent_launch", this->family().dependent_launch ? "on" : "off"},
                                         {"registers", std::to_string(registers_for(this->problem()))}});
    }

    StepWork step_work(const Problem& problem) const override {
        return delta_work<Real>(problem, this->formulation());
    }

private:
    /// Makes and uploads the slices' lists of springs beyond the lattice, uploads the slices, and chooses the
    /// kernel.
    void lay_out_off_lattice(const Problem& problem, typename DeltaBackend::Launch& launch) {
        off_lattice_ = OffLatticeLists<Real>(problem, place_guarded(problem), this->formulation(), slices_);
        slices_on_device_.upload(slices_, this->stream());
        neighbour_.upload(off_lattice_.neighbour(), this->stream());
        constants_.upload(off_lattice_.constants(), this->stream());
        off_lattice_rest_.upload(off_lattice_.off_lattice_rest(), this->stream());
        if (!by_increments(this->formulation())) calibrate_rest_lengths(constants_, this->stream());
        if (!off_lattice_.empty()) {
            const std::size_t size = roomy(off_lattice_.columns()) * slice_particles;
            neighbour_.grow(size, this->stream());
            constants_.grow(size, this->stream());
            if (off_lattice_rest_.size() > 0) off_lattice_rest_.grow(size, this->stream());
        }
        launch.step.slices = slices_on_device_.data();
        launch.step.off_lattice_neighbour = neighbour_.data();
        launch.step.off_lattice_constants = constants_.data();
        launch.step.off_lattice_rest = off_lattice_rest_.data();
        launch.source = source(problem);
        launch.kernel = this->kernel(launch.source);
    }

    KernelSource source(const Problem& problem) const {
        const std::uint32_t terms =
            (interior_ ? term_full_stencil : 0) | (off_lattice_.empty() ? 0 : term_off_lattice_springs);
        return this->family().source("delta.cu", problem, max_threads,
                                     this->blocks_with(registers_for(problem), max_threads), terms);
    }

    int registers_for(const Problem& problem) const {
        constexpr RegisterChoice choice{
            .on_positions = 40, .displacement = 40, .increment = 48, .compensated = 64};
        return ParticleBackend<Real, DeltaStep<Real>>::registers_for(registers_, problem.particle_count(),
                                                                     max_threads, {64}, choice);
    }

    bool splits_steps() const override { return true; }

    std::string refused(const Problem& problem) const override {
        return launch_refusal<Real>(place_guarded(problem).words, this->device(), this->family());
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return delta_bytes<Real>(problem, this->formulation());
    }
    std::uint64_t max_bytes_needed(const Problem& problem) const override {
        return max_delta_bytes<Real>(problem, this->formulation());
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + slices_on_device_.bytes() + lists_on_device_.bytes() +
               compliance_.bytes() + neighbour_.bytes() + constants_.bytes() + off_lattice_rest_.bytes() +
               edited_columns_.bytes() + edited_slices_.bytes();
    }

    const Options options_;
    const unsigned block_;
    const std::string registers_;
    const bool interior_;
    std::vector<Slice> slices_;
    OffLatticeLists<Real> off_lattice_;
    Buffer<Slice> slices_on_device_;
    Buffer<RowDeltas> lists_on_device_;
    Buffer<Real> compliance_;
    Buffer<std::uint32_t> neighbour_;
    Buffer<SpringConstants<Real>> constants_;
    Buffer<SpringRest<Real>> off_lattice_rest_;
    StagedRows<Real> edited_columns_;
    Staging<EditedSlice> edited_slices_;
};

const Registered entry({
    .name = "cuda_explicit_delta",
    .api = "cuda",
    .summary = "One thread per particle, neighbours by delta-compressed lists that runs of particles share, "
               "springs beyond the lattice by one list per 32 particles.",
    .strength = "only active particles have neighbour lists, and all particles of a run share one list",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    // On an H200, dependent launches make a step of the heart take 0.86 times as long. For box 96^3 they
    // change nothing.
    .tuning = tuning({{"dependent_launch", {"auto", "off", "on"}},
                      {"block", {"256", "128", "64"}},
                      // Registers per thread in float32. In float64 a thread has twice as many.
                      {"registers", {"auto", "32", "40", "48", "64", "80"}},
                      // Whether a warp whose particles all have all neighbours runs code without masks.
                      {"interior", {"vote", "mask"}}}),
    .make = [](const Options& options) { return make_by_precision<DeltaBackend>(options, options); },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return by_precision(options.precision, [&]<class Real>(Real) {
                return delta_bytes<Real>(problem, options.formulation);
            });
        },
});

}  // namespace
}  // namespace voxspring::cuda
