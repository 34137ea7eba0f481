#include "cuda/common/explicit.h"

#include <limits>
#include <numeric>
#include <utility>

#include "backends/by_precision.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/particles.h"

namespace voxspring::cuda {
namespace {

constexpr int max_threads = 512;

struct ListOptions {
    Secondary secondary = Secondary::always;
    ListLayout layout = ListLayout::vertical;
    unsigned block = 128;  ///< threads per block
    bool rows = false;     ///< counters=rows: the paper's rows (ListRows) precede the lists

    ListOptions(Secondary when, const Options& options)
        : secondary(when),
          layout(options.tuning.at("layout") == "vertical" ? ListLayout::vertical : ListLayout::concatenated),
          block(unsigned(std::stoul(options.tuning.at("block")))),
          rows(options.tuning.at("counters") == "rows") {
        if (when == Secondary::where_needed && options.tuning.at("secondary") == "always")
            secondary = Secondary::always;
    }

    bool has_secondary(const Problem& problem) const {
        return secondary == Secondary::always ||
               (secondary == Secondary::where_needed && !grouped_list_refusal(problem).empty());
    }
};

template <class Real>
std::uint64_t explicit_bytes(const Problem& problem, const ListOptions& options, Formulation formulation) {
    const bool secondary = options.has_secondary(problem);
    const bool off_lattice_rest = !problem.springs.empty() && !on_positions(formulation);
    const std::uint32_t slots = secondary ? slots_by_springs(problem) : slots_by_groups(problem);
    const auto particles = std::uint32_t(problem.particle_count());
    return particle_bytes<Real>(problem, place_compact(problem), formulation) +
           (options.rows ? ListRows::size(particles, secondary) * sizeof(std::uint32_t) : 0) +
           list_size(problem.particle_count(), slots, options.layout) *
               (sizeof(std::uint32_t) + (secondary ? sizeof(SpringConstants<Real>) : 0) +
                (off_lattice_rest ? sizeof(SpringRest<Real>) : 0));
}

template <class Real>
class ExplicitBackend final : public ParticleBackend<Real, ExplicitStep<Real>> {
public:
    ExplicitBackend(const KernelFamily& family, const ListOptions& options)
        : ParticleBackend<Real, ExplicitStep<Real>>(family), options_(options) {}

    void upload(const Problem& problem, const State& state) override {
        this->template begin_upload<Real>();
        const auto [launch, bits] = lay_out(problem);
        this->start(problem, state, place_compact(problem), bits, launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        if (edit.empty()) return;
        const ExplicitStep<Real>& step = this->launch().step;
        const bool secondary = options_.has_secondary(edited);
        // Lists with rows are laid out anew, never edited in place: rows exist to compare with the paper,
        // which timed no edits.
        if (options_.rows || secondary != (step.constants != nullptr) ||
            longest_list(edit) > step.shape.slots ||
            (needs_off_lattice_rest(edited) && step.off_lattice_rest == nullptr)) {
            lay_out_anew(edited);
            return;
        }
        const Formulation formulation = this->formulation();
        const EditedLists<Real> rows =
            secondary ? edited_by_springs<Real>(edited, edit, step.shape.slots, formulation)
                      : edited_by_groups<Real>(edited, edit, step.shape.slots, formulation);
        write_rows(edited_rows_.send(rows, !by_increments(formulation), this->stream()), rows.particle.size(),
                   step.shape, this->current_words(), neighbour_.data(), constants_.data(),
                   off_lattice_rest_.data(), this->stream());
    }

    StepWork step_work(const Problem& problem) const override {
        const bool secondary = options_.has_secondary(problem);
        StepWork work = explicit_work<Real>(problem, secondary, this->formulation());
        // By counters=rows, ListRows are read too: where each list begins, and how many entries it has.
        // That count is one number with the secondary list, otherwise one number per spring group.
        const int groups = int((problem.group_bits & FACE_BITS) != 0) +
                           int((problem.group_bits & EDGE_BITS) != 0) +
                           int((problem.group_bits & CORNER_BITS) != 0);
        if (options_.rows)
            work.read_once(problem.particle_count() * std::size_t(secondary ? 2 : 1 + groups) *
                           sizeof(std::uint32_t));
        return work;
    }

private:
    struct LaidOut {
        typename ExplicitBackend::Launch launch;
        std::vector<std::uint32_t> bits;
    };

    bool needs_off_lattice_rest(const Problem& problem) const {
        return !problem.springs.empty() && !on_positions(this->formulation());
    }

    /// Makes and uploads the lists.
    LaidOut lay_out(const Problem& problem) {
        const bool secondary = options_.has_secondary(problem);
        const Formulation formulation = this->formulation();
        NeighbourLists<Real> lists = secondary ? list_by_springs<Real>(problem, options_.layout, formulation)
                                               : list_by_groups<Real>(problem, options_.layout, formulation);
        if (options_.rows) put_rows_ahead(lists);
        neighbour_.upload(lists.neighbour, this->stream());
        constants_.upload(lists.constants, this->stream());
        off_lattice_rest_.upload(lists.off_lattice_rest, this->stream());

        typename ExplicitBackend::Launch launch;
        launch.block = dim3(options_.block);
        launch.grid = dim3(blocks_for(problem.particle_count(), options_.block));
        launch.step = make_explicit_step<Real>(problem, lists, formulation);
        launch.step.neighbour =
            neighbour_.data() + (options_.rows ? ListRows::size(launch.step.particles, secondary) : 0);
        launch.step.constants = constants_.data();
        launch.step.off_lattice_rest = off_lattice_rest_.data();
        if (!by_increments(formulation)) {
            calibrate_rest_lengths(constants_, this->stream());
            calibrate_rest_lengths<Real>(launch.step.rest_length, this->stream());
        }
        constexpr int blocks = sizeof(Real) == sizeof(float) ? 2 : 1;
        KernelSource source =
            this->family().source("explicit.cu", problem, max_threads, blocks,
                                  needs_off_lattice_rest(problem) ? term_off_lattice_rests : 0);
        if (secondary) source.macros["SECONDARY"] = "1";
        if (options_.rows) source.macros["ROWS"] = "1";
        launch.kernel = this->kernel(source);
        launch.source = source;
        return {launch, std::move(lists.bits)};
    }

    /// Lays out the lists anew, for example with more slots, or with a secondary list that they lacked. The
    /// particles stay where they are.
    void lay_out_anew(const Problem& edited) {
        this->synchronize();
        auto [launch, bits] = lay_out(edited);
        launch.step.motion = this->launch().step.motion;
        this->resume(launch);
        std::vector<std::uint32_t> all(edited.particle_count());
        std::iota(all.begin(), all.end(), 0U);
        this->write_particle_bits(all, bits);
    }

    bool splits_steps() const override { return true; }

    std::string refused(const Problem& problem) const override {
        if (options_.secondary == Secondary::never) {
            if (const std::string why = grouped_list_refusal(problem); !why.empty())
                return "the neighbour lists have one stiffness and one rest length for all face springs, one "
                       "for all edge springs and one for all corner springs: " +
                       why;
        }
        if (std::string why = list_entry_refusal(problem.particle_count(), this->formulation()); !why.empty())
            return why;
        if (options_.rows && options_.layout == ListLayout::concatenated) {
            const std::size_t entries =
                problem.particle_count() *
                (options_.has_secondary(problem) ? slots_by_springs(problem) : slots_by_groups(problem));
            if (entries > std::numeric_limits<std::uint32_t>::max())
                return std::to_string(entries) +
                       " list entries are too many for counters=rows, whose indices have 32 bits; use "
                       "counters=word";
        }
        return launch_refusal<Real>(problem.particle_count(), this->device(), this->family());
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return explicit_bytes<Real>(problem, options_, this->formulation());
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + neighbour_.bytes() + constants_.bytes() +
               off_lattice_rest_.bytes() + edited_rows_.bytes();
    }

    const ListOptions options_;
    Buffer<std::uint32_t> neighbour_;
    Buffer<SpringConstants<Real>> constants_;
    Buffer<SpringRest<Real>> off_lattice_rest_;
    StagedRows<Real> edited_rows_;
};

}  // namespace

BackendEntry explicit_entry(const std::string& name, const std::string& summary, const TuningValues& fetches,
                            Secondary secondary) {
    const auto make = [secondary](const Options& options) {
        const ListOptions chosen(secondary, options);
        const KernelFamily family(options, fetch_path(options.tuning.at("fetch")));
        return make_by_precision<ExplicitBackend>(options, family, chosen);
    };
    const auto bytes = [secondary](const Problem& problem, const Options& options) {
        const ListOptions chosen(secondary, options);
        return by_precision(options.precision, [&]<class Real>(Real) {
            return explicit_bytes<Real>(problem, chosen, options.formulation);
        });
    };
    std::map<std::string, TuningValues> own = {
        // Whether a step is launched while the step before it still runs.
        {"dependent_launch", {"off", "on"}},
        {"block", {"128", "64", "256", "512"}},
        {"fetch", fetches},
        // The layouts of the paper's Figures 6 b and 6 a.
        {"layout", {"vertical", "concatenated"}},
        // Where the length of a list is stored. `word`: in the particle's word; entries are read in chunks.
        // `rows`: in the paper's rows (ListRows); entries are read one by one.
        {"counters", {"word", "rows"}},
        // Whether steps are replayed from a graph, or launched one by one, as in the paper.
        {"graph", {"on", "off"}}};
    // `always`: the secondary list is stored even if the scene does not need it, as in the paper.
    if (secondary == Secondary::where_needed) own["secondary"] = {"where_needed", "always"};
    return {.name = name,
            .api = "cuda",
            .summary = summary,
            .precisions = {Precision::float32, Precision::float64},
            .formulations = every_formulation,
            .tuning = tuning(own),
            .make = make,
            .bytes = bytes};
}

}  // namespace voxspring::cuda
