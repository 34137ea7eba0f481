// One cooperative launch for thousands of steps. The positions of a block's particles stay in registers and
// shared memory. Those of particles at a block's border go to other blocks through L2, or by NVLink to the
// part of the body that another device steps.
#include <algorithm>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "backends/layout/blocks.h"
#include "backends/layout/brick_layout.h"
#include "backends/layout/resident_layout.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "backends/outpaced.h"
#include "backends/registry.h"
#include "cuda/common/axes_backend.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/device_borders.h"
#include "cuda/common/edit.h"
#include "cuda/common/joint_launch.h"
#include "cuda/common/particles.h"
#include "cuda/common/ticks.h"
#include "cuda/device/serialiser.h"

namespace voxspring::cuda {
namespace {

/// The tables of a ResidentStep on the device.
class ResidentTables {
public:
    /// Uploads the tables and points `step` at them. `mask`: a Lattice::mask.
    void upload(const ResidentLayout& layout, const std::vector<std::uint32_t>& mask, ResidentStep& step,
                const Stream& stream) {
        const auto send = [&](auto& buffer, const auto& values, auto& pointer) {
            buffer.upload(values, stream);
            pointer = buffer.data();
        };
        send(particle_, layout.particle, step.particle);
        send(published_, layout.published, step.published);
        send(polled_, layout.polled, step.polled);
        send(polled_word_, layout.polled_word, step.polled_word);
        send(own_slot_, own_slots_with(layout, mask), step.own_slot);
        send(slot_, slots_with(layout, mask), step.slot);
        send(polled_slot_, layout.polled_slot, step.polled_slot);
        send(border_, layout.border, step.border);
        // An exchange is the array into which blocks, and other parts of the body, store positions. Another
        // part may still write to this part's old exchange and share its ownership. Then this part gets a new
        // exchange.
        if (exchange_.use_count() > 1) exchange_ = std::make_shared<Buffer<TaggedPoint>>();
        exchange_->resize(std::size_t(2) * layout.published_count);
        exchange_->fill_with_zeros(stream);
        step.exchange = exchange_->data();
        step.lane_count = layout.lane_count();
        step.published_count = layout.published_count;
    }
    std::uint16_t* slot() const { return slot_.data(); }
    const std::shared_ptr<Buffer<TaggedPoint>>& exchange() const { return exchange_; }
    std::uint64_t bytes() const {
        return particle_.bytes() + published_.bytes() + polled_.bytes() + polled_word_.bytes() +
               own_slot_.bytes() + slot_.bytes() + polled_slot_.bytes() + border_.bytes() +
               exchange_->bytes();
    }

private:
    Buffer<std::uint32_t> particle_, published_, polled_, polled_word_;
    Buffer<std::uint16_t> own_slot_, slot_, polled_slot_;
    Buffer<std::uint8_t> border_;
    std::shared_ptr<Buffer<TaggedPoint>> exchange_ = std::make_shared<Buffer<TaggedPoint>>();
};

/// The borders of a part of a body. The part's kernel sends the points at its borders into the exchanges of
/// the parts beside it.
class ResidentBorders final : public DeviceBorders {
public:
    /// `problem` and `layout` are those of this part. `steps_per_call`: the most steps per launch.
    ResidentBorders(const std::vector<SharedParticles>& borders, const Problem& problem,
                    const std::shared_ptr<const ResidentLayout>& layout,
                    const std::shared_ptr<Buffer<TaggedPoint>>& exchange, const Device& device,
                    const Stream& stream, int steps_per_call)
        : layout_(layout),
          exchange_(exchange),
          device_(device.number),
          stream_(stream),
          steps_per_call_(steps_per_call) {
        for (const SharedParticles& shared : borders) {
            beside_.push_back(shared.part);
            sendings_.push_back({shared.sent, {}});
            words_.push_back(words_of_ghosts(*layout, problem, shared.received));
        }
        if (const std::string why = sent_refusal(sendings_); !why.empty()) throw Unavailable(why);
    }

    std::size_t bytes() const override {
        std::size_t points = 0;
        for (const ResidentSending& sending : sendings_) points += sending.particles.size();
        return points * sizeof(TaggedPoint);
    }

    /// Allocates and uploads all that launches need to send points. It is done here because nothing may be
    /// allocated or freed later, while other parts wait for this one.
    void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) override {
        for (std::size_t border = 0; border < beside_.size(); ++border) {
            const auto* const theirs =
                dynamic_cast<const ResidentBorders*>(parts.at(std::size_t(beside_[border])).get());
            if (theirs == nullptr)
                throw std::logic_error("the parts of a body exchange borders in different ways");
            require_whole_words(device_, theirs->device_);
            require_peer_access(device_, theirs->device_);
            const auto back = std::find(theirs->beside_.begin(), theirs->beside_.end(), int(part));
            sendings_[border].words = theirs->words_.at(std::size_t(back - theirs->beside_.begin()));
            their_exchanges_.push_back(theirs->exchange_);
            links_.neighbour[border] = {theirs->exchange_->data(), theirs->layout_->published_count};
        }
        sent_.upload(sent_by_lanes(*layout_, sendings_), stream_);
        links_.sent = sent_.data();
        stream_.synchronize();  // the exchange must be empty before another part writes to it
    }

    int steps_per_call() const override { return steps_per_call_; }
    void send() override {}
    void receive() override {}

    const ResidentLinks& links() const { return links_; }
    std::uint64_t device_bytes() const { return sent_.bytes(); }

private:
    const std::shared_ptr<const ResidentLayout> layout_;
    const std::shared_ptr<Buffer<TaggedPoint>> exchange_;
    const int device_;
    const Stream& stream_;
    const int steps_per_call_;
    std::vector<int> beside_;  ///< the number of the part on the other side of each border
    std::vector<ResidentSending> sendings_;
    /// Per border: the words of exchange_ to which the other part's points go.
    std::vector<std::vector<std::uint32_t>> words_;
    /// The other parts' exchanges, kept alive for as long as a launch may write to them.
    std::vector<std::shared_ptr<Buffer<TaggedPoint>>> their_exchanges_;
    Buffer<std::uint32_t> sent_;
    ResidentLinks links_{};
};

/// An estimate of the device memory in bytes. It assumes that every particle is published (stored for other
/// blocks) and that every lane has a particle, and leaves out the tables of polls.
std::uint64_t resident_bytes(const Problem& problem, const Options& options) {
    return particle_bytes<float>(problem, place_compact(problem), options.formulation) +
           problem.particle_count() * (2 * sizeof(TaggedPoint) + 2 * sizeof(std::uint32_t) +
                                       (1 + neighbour_bits + slots_together) * sizeof(std::uint16_t));
}

/// The value of the macro TOOL.
std::string name_of(ToolMode mode) {
    if (mode == ToolMode::none) return "none";
    return mode == ToolMode::launch ? "launch" : "ticks";
}

Partition partition_of(const std::string& tuned) {
    if (tuned == "rows") return Partition::rows;
    return tuned == "bisection" ? Partition::bisection : Partition::automatic;
}

class ResidentBackend final : public ParticleBackend<float, ResidentStep>, public Outpaced {
public:
    explicit ResidentBackend(const Options& options)
        : ParticleBackend(KernelFamily(options, Fetch::past_l1)),
          options_(options),
          partition_(partition_of(options.tuning.at("partition"))),
          pollers_(std::stoi(options.tuning.at("pollers"))),
          in_ticks_(options.tuning.at("ticks") == "resident"),
          joint_(device().ends_long_kernels),
          ticks_(
              stream(), [this](const TickLine& line, std::uint32_t again) { launch_ticks(line, again); },
              [this] { wait_for_stream(); }) {}
    ResidentBackend(const ResidentBackend&) = delete;
    ResidentBackend& operator=(const ResidentBackend&) = delete;
    /// Ends a launch that still runs, since it uses memory of this object.
    ~ResidentBackend() override {
        try {
            ResidentBackend::let_end();
        } catch (const DeviceError&) {
            // The launch has ended or will end by itself, and there is no caller left to report to.
        }
        static_cast<void>(cudaStreamSynchronize(stream().get()));
    }

    void upload(const Problem& problem, const State& state) override {
        begin_upload<float>();
        borders_.reset();
        if (tool_mode_for(problem) == ToolMode::ticks) ticks_.open(problem.tool.particles.size());
        start(problem, state, place_compact(problem), problem.lattice.mask, prepare(problem));
    }

    /// A tool that moves leaves few steps per launch instead of thousands. Otherwise empty unless threads
    /// have several particles. Then cuda_bricks may be faster: the rules of `--backend auto` come from cards
    /// with enough multiprocessors for one particle per thread.
    std::string outpaced(const Problem& problem) const override {
        if (problem.has_tool()) return "a tool ends its launches after few steps";
        const auto bricks = registry().find("cuda_bricks");
        const auto layout = layout_of(problem, stressed_at_rest(problem));
        if (layout->turns == 1 || bricks == registry().end()) return {};
        const auto& known = bricks->second.formulations;
        if (std::find(known.begin(), known.end(), formulation()) == known.end() || !problem.ghosts.empty() ||
            !class_refusal(problem, Precision::float32, formulation(), "bricks").empty())
            return {};
        const MarchDevice planned = march_device(device());
        return outpaced_by_bricks(
            *layout, plan_bricks(problem, formulation(), planned, moves_registers(device().architecture)),
            planned.hertz);
    }

    Capabilities capabilities() const override {
        Capabilities all = ParticleBackend::capabilities();
        all.border_ways = {"stores"};
        return all;
    }
    /// Also keeps the borders that it returns, since every launch gets their links as an argument.
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& borders,
                                                  const std::string&) override {
        borders_ = std::make_shared<ResidentBorders>(borders, problem(), layout_, tables_.exchange(),
                                                     device(), stream(), longest_joint_launch(monitored()));
        return borders_;
    }

    /// Only stores the displacement. The next launch, or the next order to a launch that goes on (Ticks),
    /// carries it to the device.
    void move_tool(const glm::dvec3& displacement) override { moved_ = vector_of<float>(displacement); }
    glm::dvec3 tool_force() override {
        if (steps() == 0 || tool_mode_ != ToolMode::ticks) return ParticleBackend::tool_force();
        const glm::dvec3 force = force_on_tool(ticks_.forces());
        check_waits();
        return force;
    }

    /// Rewrites the masks of the particles that the edit touches. Also rewrites, for springs that are cut or
    /// joined, the table of slots, which tells a thread where its particle's neighbours are in shared memory.
    /// Nothing else changes, since the tables have room for every spring of the lattice's groups. No launch
    /// runs meanwhile: let_end() ends one that goes on, and the stream orders all others.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        set_problem(edited);
        if (edit.empty()) return;
        let_end();
        const ResidentEdit written = resident_edit(*layout_, edit);
        launch_for_each(*support_kernels<float>().write_slots_and_bits, written.words.size(), stream(),
                        tables_.slot(), written.slots, current_words(),
                        staging_.send(std::span(written.words), stream()), written.words.size());
    }

    std::optional<Choice> choice() const override {
        return choice_of_auto(options_, {{"partition", layout_->in_rows ? "rows" : "bisection"}});
    }

    StepWork step_work(const Problem& problem) const override {
        return without_traffic(implicit_work<float>(problem, formulation()));
    }

private:
    /// False because particles are in device memory only at the end of a launch, not after each step. Within
    /// a launch, the object that device_borders() returns exchanges the borders.
    bool gives_borders() const override { return false; }

    /// This part's share of the device. The blocks of all parts on a device wait for each other, so there
    /// must be room for all of them at once.
    ResidentCard card() const { return {device().multiprocessors / device().parts, device().shared_bytes}; }

    ToolMode tool_mode_for(const Problem& problem) const {
        if (!problem.has_tool()) return ToolMode::none;
        return in_ticks_ ? ToolMode::ticks : ToolMode::launch;
    }

    /// Whether a spring of the lattice pulls while all particles are at rest.
    static bool is_stressed(const ImplicitStep<float>& step) {
        return std::any_of(std::begin(step.deficit), std::end(step.deficit),
                           [](float deficit) { return deficit != 0; });
    }

    bool stressed_at_rest(const Problem& problem) const {
        return is_stressed(make_implicit_step<float>(problem, place_on_grid(problem.lattice), formulation()));
    }

    /// The tables for `problem`, whose lattice may be `stressed` at rest. The latest tables are used again
    /// for the same body, even with other springs: refused() and the upload after it need the same tables.
    std::shared_ptr<const ResidentLayout> layout_of(const Problem& problem, bool stressed) const {
        if (latest_ && latest_->stressed == stressed && latest_->group_bits == problem.group_bits &&
            latest_->dims == problem.lattice.dims && latest_->voxel == problem.lattice.voxel &&
            latest_->ghosts == problem.ghosts)
            return latest_->layout;
        // Springs that pull at rest need masks. Overlap may mirror a warp's tables, but not its masks.
        const bool overlap = options_.tuning.at("overlap") == "on" && !stressed;
        latest_ = {stressed,
                   problem.group_bits,
                   problem.lattice.dims,
                   problem.lattice.voxel,
                   problem.ghosts,
                   std::make_shared<const ResidentLayout>(
                       lay_out_resident(problem, card(), pollers_, partition_, overlap))};
        return latest_->layout;
    }

    Launch prepare(const Problem& problem) {
        Launch launch;
        static_cast<ImplicitStep<float>&>(launch.step) =
            make_implicit_step<float>(problem, place_on_grid(problem.lattice), formulation());
        const bool stressed = is_stressed(launch.step);
        layout_ = layout_of(problem, stressed);
        const ResidentLayout& layout = *layout_;
        tool_mode_ = tool_mode_for(problem);
        tool_stiffness_ = float(problem.tool.stiffness);
        if (std::string why = block_refusal(layout, card(), tool_mode_); !why.empty()) throw DeviceError(why);
        if (!by_increments(formulation())) calibrate_rest_lengths<float>(launch.step.rest_length, stream());
        tables_.upload(layout, problem.lattice.mask, launch.step, stream());
        held_by_lane_.upload(
            problem.has_tool() ? held_by_lanes(layout, problem.tool.particles) : std::vector<std::uint32_t>(),
            stream());
        joint_.start_anew(stream());
        launch.step.started_blocks = joint_.started_blocks();
        launch.step.wait = joint_.wait_limit();
        launch.grid = dim3(unsigned(layout.blocks));
        launch.block = dim3(unsigned(layout.threads() + layout.pollers));
        KernelSource source = family().source("resident.cu", problem, int(launch.block.x), 1);
        source.macros["LANES"] = std::to_string(layout.threads());
        source.macros["TURNS"] = std::to_string(layout.turns);
        source.macros["POLLERS"] = std::to_string(layout.pollers);
        source.macros["ROUNDS"] = std::to_string(layout.rounds);
        source.macros["SLOTS"] = std::to_string(layout.slots);
        source.macros["BORDERS"] = std::to_string(layout.border_kinds);
        source.macros["MASKED"] = stressed ? "1" : "0";
        source.macros["TOOL"] = name_of(tool_mode_);
        is_part_ = !problem.ghosts.empty();
        source.macros["PART"] = is_part_ ? "1" : "0";
        launch.kernel = kernel(source);
        if (layout.turns > 1) {
            launch.shared_bytes = layout.shared_bytes(tool_mode_);
            launch.kernel->allow_shared(launch.shared_bytes);
        }
        return launch;
    }

    void enqueue_steps(int count) override {
        if (tool_mode_ == ToolMode::ticks) return order_steps(count);
        joint_.enqueue(
            count, longest_joint_launch(monitored()), stream(),
            [&](int steps, std::uint32_t tag, std::uint32_t launches) {
                if (tool_mode_ == ToolMode::none) {
                    enqueue_launch(launch().step, steps, tag, launches);
                } else {
                    enqueue_launch(held_step(), steps, tag, launches);
                }
            },
            [&](int steps) { stepped(steps); });
    }
    template <class Step>
    void enqueue_launch(const Step& step, int steps, std::uint32_t tag, std::uint32_t launches) const {
        const auto enqueue = [&](const auto& argument) {
            launch_words_together(launch(), argument, steps, tag, launches);
        };
        if (is_part_) {
            if (!borders_) throw std::logic_error("a part of a body is stepped before it has borders");
            enqueue(PartStep<Step>{step, borders_->links()});
        } else {
            enqueue(step);
        }
    }
    HeldResidentStep held_step(const TickLine& line = {}) const {
        return {launch().step, held_by_lane_.data(), held().data(), {moved_, tool_stiffness_}, held_forces(),
                line};
    }

    // --- Ticks: one launch goes on, and takes the steps of each order that the host gives ---

    void order_steps(int count) {
        while (count > 0) {
            const int steps = std::min(count, longest_joint_launch(monitored()));
            ticks_.order(moved_, std::uint32_t(steps));
            joint_.advance_tag(steps);
            count -= steps;
            stepped(steps);
        }
    }
    void launch_ticks(const TickLine& line, std::uint32_t again) {
        joint_.open([&](std::uint32_t tag, std::uint32_t launches) {
            enqueue_launch(held_step(line), 0, tag, launches);
        });
        joint_.advance_tag(int(again));
    }
    void let_end() override { ticks_.end(); }

    std::string refused(const Problem& problem) const override {
        if (std::string why = resident_refusal(problem, card().blocks, device().launches_together);
            !why.empty())
            return why;
        const ToolMode mode = tool_mode_for(problem);
        if (std::string why = part_refusal(problem, mode); !why.empty()) return why;
        if (mode == ToolMode::ticks && device().ends_long_kernels)
            return "ticks=resident: on a device with a display the driver ends kernels that run for "
                   "seconds; use ticks=launch";
        if (mode == ToolMode::ticks) {
            if (const std::string why = launches_block(); !why.empty())
                return "ticks=resident: " + why +
                       ", and the host could order nothing while its kernel runs; use ticks=launch";
        }
        return block_refusal(*layout_of(problem, stressed_at_rest(problem)), card(), mode);
    }
    /// Empty, or why `problem`, if it is a part of a body, cannot be stepped.
    std::string part_refusal(const Problem& problem, ToolMode mode) const {
        if (problem.ghosts.empty()) return {};
        if (mode == ToolMode::ticks)
            return "ticks=resident: parts of a body would receive the host's orders at different steps; "
                   "use ticks=launch";
        if (options_.tuning.at("overlap") == "on")
            return "overlap=on would give a part other bits than the whole body, because it adds the springs "
                   "across a block's border last and the blocks of a part have other borders; "
                   "use overlap=off";
        if (device().ends_long_kernels)
            return "on a device with a display the driver ends kernels that run for seconds, and the "
                   "kernel of a part may wait that long for the other parts";
        if (const std::string why = serialised_by(device().parts); !why.empty())
            return why + ", but the kernels of a body's parts wait for each other";
        return {};
    }

    std::uint64_t bytes_needed(const Problem& problem) const override {
        return resident_bytes(problem, options_);
    }
    std::uint64_t bytes_held() const override {
        return particle_bytes_held() + tables_.bytes() + joint_.bytes() + held_by_lane_.bytes() +
               ticks_.bytes() + staging_.bytes() + (borders_ ? borders_->device_bytes() : 0);
    }

    std::string failure_note() const override { return joint_.failure_note("resident block"); }

    const Options options_;
    const Partition partition_;
    const int pollers_;
    const bool in_ticks_;  ///< ticks=resident: one launch serves all ticks of a tool
    ResidentTables tables_;
    /// The latest layout and everything that it depends on. refused() and the upload after refused() need the
    /// same layout.
    struct LaidOut {
        bool stressed;
        std::uint32_t group_bits;
        glm::ivec3 dims;
        std::vector<std::uint32_t> voxel, ghosts;
        std::shared_ptr<const ResidentLayout> layout;
    };
    mutable std::optional<LaidOut> latest_;
    std::shared_ptr<const ResidentLayout> layout_;  ///< the layout of the latest upload
    Staging<EditedWord> staging_;
    JointLaunch joint_;
    Buffer<std::uint32_t> held_by_lane_;
    // Values copied at the latest upload: a launch may have to begin again after the problem is gone.
    ToolMode tool_mode_ = ToolMode::none;
    float tool_stiffness_ = 0;
    Vector<float> moved_{};  ///< displacement of the tool from the next step on
    Ticks ticks_;
    bool is_part_ = false;                      ///< this backend steps a part of a body, others the rest
    std::shared_ptr<ResidentBorders> borders_;  ///< set for a part
};

const Registered entry({
    .name = "cuda_resident",
    .api = "cuda",
    .addressing = Addressing::by_grid,
    .summary = "One launch for thousands of steps, particles in registers, borders of blocks through L2.",
    .strength = "positions stay on the chip from step to step",
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement,
                     Formulation::paper},
    .tuning = tuning({{"partition", {"auto", "rows", "bisection"}},
                      {"overlap", {"on", "off"}},
                      {"pollers", {"256", "128", "512"}},
                      // With a tool: each call of step() makes launches, or a launch goes on between calls.
                      {"ticks", {"launch", "resident"}}}),
    .make = [](const Options& options) { return std::make_unique<ResidentBackend>(options); },
    .bytes = resident_bytes,
});

}  // namespace
}  // namespace voxspring::cuda
