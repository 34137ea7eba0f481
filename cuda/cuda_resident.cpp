// One cooperative launch for thousands of steps: a block's particles stay in registers and shared memory,
// what crosses its border goes through L2.
#include <algorithm>
#include <memory>
#include <optional>

#include "backends/layout/blocks.h"
#include "backends/layout/resident_layout.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "cuda/common/joint_launch.h"
#include "cuda/common/measure.h"
#include "cuda/common/particles.h"
#include "cuda/common/tuning.h"

namespace voxspring::cuda {
namespace {

/// ResidentStep's tables on the device.
class ResidentTables {
public:
    void upload(const ResidentLayout& layout, ResidentStep& step, const Stream& stream) {
        const auto send = [&](auto& buffer, const auto& values, auto& pointer) {
            buffer.upload(values, stream);
            pointer = buffer.data();
        };
        send(particle_, layout.particle, step.particle);
        send(published_, layout.published, step.published);
        send(polled_, layout.polled, step.polled);
        send(polled_word_, layout.polled_word, step.polled_word);
        send(own_slot_, layout.own_slot, step.own_slot);
        send(slot_, layout.slot, step.slot);
        send(polled_slot_, layout.polled_slot, step.polled_slot);
        send(border_, layout.border, step.border);
        exchange_.resize(std::size_t(2) * layout.published_count);
        exchange_.fill_with_zeros(stream);
        step.exchange = exchange_.data();
        step.lane_count = layout.lane_count();
        step.published_count = layout.published_count;
    }
    std::uint64_t bytes() const {
        return particle_.bytes() + published_.bytes() + polled_.bytes() + polled_word_.bytes() +
               own_slot_.bytes() + slot_.bytes() + polled_slot_.bytes() + border_.bytes() + exchange_.bytes();
    }

private:
    Buffer<std::uint32_t> particle_, published_, polled_, polled_word_;
    Buffer<std::uint16_t> own_slot_, slot_, polled_slot_;
    Buffer<std::uint8_t> border_;
    Buffer<TaggedPoint> exchange_;
};

/// What the tables take where every particle is published and every lane has one.
std::uint64_t resident_bytes(const Problem& problem, const Options& options) {
    return particle_bytes<float>(problem, place_compact(problem), options.formulation) +
           problem.particle_count() * (2 * sizeof(TaggedPoint) + 2 * sizeof(std::uint32_t) +
                                       (1 + neighbour_bits) * sizeof(std::uint16_t));
}

Partition partition_of(const std::string& tuned) {
    if (tuned == "rows") return Partition::rows;
    return tuned == "bisection" ? Partition::bisection : Partition::automatic;
}

class ResidentBackend final : public ParticleBackend<float, ResidentStep> {
public:
    explicit ResidentBackend(const Options& options)
        : ParticleBackend(KernelFamily(options, Fetch::past_l1)),
          options_(options),
          partition_(partition_of(options.tuning.at("partition"))),
          pollers_(std::stoi(options.tuning.at("pollers"))) {}

    void upload(const Problem& problem, const State& state) override {
        begin_upload();
        start(problem, state, place_compact(problem), problem.lattice.mask, prepare(problem));
    }

    /// A launch takes many steps, and reads no load that changes meanwhile.
    bool has_tool() const override { return false; }

    /// Every table anew: which particles a block steps stays, but not what its neighbours are.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        set_problem(edited);
        if (edit.empty()) return;
        synchronize();
        Launch launch = prepare(edited);
        launch.step.motion = this->launch().step.motion;
        resume(launch);
        write_masks(edit);
    }

    /// That of an implicit step without its memory: the state leaves registers at the end of a launch alone.
    StepWork step_work(const Problem& problem) const override {
        StepWork work = implicit_work<float>(problem, formulation());
        work.bytes = work.written_bytes = work.footprint_bytes = 0;
        work.launches = 0;
        work.exchanges = 1;
        return work;
    }

private:
    /// Whether a spring of the lattice pulls while its particles are where they rest.
    static bool is_stressed(const ImplicitStep<float>& step) {
        return std::any_of(std::begin(step.deficit), std::end(step.deficit),
                           [](float deficit) { return deficit != 0; });
    }

    /// The tables for `problem`; those that refused() made if it is the same body.
    const ResidentLayout& layout_of(const Problem& problem, bool stressed) const {
        if (latest_ && latest_->stressed == stressed && latest_->dims == problem.lattice.dims &&
            latest_->voxel == problem.lattice.voxel && latest_->mask == problem.lattice.mask)
            return latest_->layout;
        // Masks are not mirrored.
        const bool overlap = options_.tuning.at("overlap") == "on" && !stressed;
        latest_ = {stressed, problem.lattice.dims, problem.lattice.voxel, problem.lattice.mask,
                   lay_out_resident(problem, device().multiprocessors(), pollers_, partition_, overlap)};
        return latest_->layout;
    }

    Launch prepare(const Problem& problem) {
        Launch launch;
        static_cast<ImplicitStep<float>&>(launch.step) =
            make_implicit_step<float>(problem, place_on_grid(problem.lattice), formulation());
        const bool stressed = is_stressed(launch.step);
        const ResidentLayout& layout = layout_of(problem, stressed);
        if (std::string why = too_much_for_a_block(layout); !why.empty()) throw DeviceError(why);
        if (!by_increments(formulation())) calibrate_rest_lengths<float>(launch.step.rest_length, stream());
        tables_.upload(layout, launch.step, stream());
        joint_.start_anew(stream());
        launch.step.started_blocks = joint_.started_blocks();
        launch.step.stall = joint_.stall();
        launch.grid = dim3(unsigned(layout.blocks));
        launch.block = dim3(unsigned(layout.lanes + layout.pollers));
        KernelSource source = family().source("resident.cu", problem, int(launch.block.x), 1);
        source.macros["LANES"] = std::to_string(layout.lanes);
        source.macros["POLLERS"] = std::to_string(layout.pollers);
        source.macros["ROUNDS"] = std::to_string(layout.rounds);
        source.macros["SLOTS"] = std::to_string(layout.slots);
        source.macros["BORDERS"] = std::to_string(layout.border_kinds);
        source.macros["MASKED"] = stressed ? "1" : "0";
        launch.kernel = kernel(source);
        return launch;
    }

    void enqueue_steps(int count) override {
        joint_.enqueue(
            count, longest_joint_launch(monitored()),
            [&](int steps, std::uint32_t tag, std::uint32_t launches) {
                launch_words_together(*launch().kernel, launch().grid, launch().block, launch().step, steps,
                                      tag, launches);
            },
            [&](int steps) { stepped(steps); });
    }

    std::string refused(const Problem& problem) const override {
        if (std::string why =
                resident_refusal(problem, device().multiprocessors(), device().launches_together());
            !why.empty())
            return why;
        return too_much_for_a_block(layout_of(
            problem,
            is_stressed(make_implicit_step<float>(problem, place_on_grid(problem.lattice), formulation()))));
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return resident_bytes(problem, options_);
    }
    std::uint64_t bytes_held() const override {
        return particle_bytes_held() + tables_.bytes() + joint_.bytes();
    }

    std::string failure_note() const override { return joint_.failure_note("resident block"); }

    const Options options_;
    const Partition partition_;
    const int pollers_;
    ResidentTables tables_;
    /// The latest layout and all that it follows from: refused() and the upload after it ask for the same.
    struct LaidOut {
        bool stressed;
        glm::ivec3 dims;
        std::vector<std::uint32_t> voxel, mask;
        ResidentLayout layout;
    };
    mutable std::optional<LaidOut> latest_;
    JointLaunch joint_;
};

const Registered entry({
    .name = "cuda_resident",
    .summary = "One launch for thousands of steps, particles in registers, borders through L2.",
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement,
                     Formulation::paper},
    .tuning = tuning({{"partition", {"auto", "rows", "bisection"}},
                      {"overlap", {"on", "off"}},
                      {"pollers", {"256", "128", "512"}}}),
    .make = [](const Options& options) { return std::make_unique<ResidentBackend>(options); },
    .bytes = resident_bytes,
});

}  // namespace
}  // namespace voxspring::cuda
