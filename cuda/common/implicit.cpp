#include "cuda/common/implicit.h"

#include <algorithm>
#include <optional>

#include "backends/by_precision.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "backends/physics/addressing.h"
#include "backends/rest_policy.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/particles.h"
#include "cuda/common/resting.h"

namespace voxspring::cuda {
namespace {

constexpr int max_threads = 256;

template <class Real>
std::uint64_t implicit_bytes(const Problem& problem, BlockShape shape, Formulation formulation) {
    const Placement placement = place_on_grid(problem.lattice);
    return particle_bytes<Real>(problem, placement, formulation) +
           (problem.has_materials() ? placement.words * sizeof(Real) : 0) +
           occupied_blocks(problem.lattice, shape).size() * sizeof(BlockOrigin);
}

template <class Real>
class ImplicitBackend final : public ParticleBackend<Real, ImplicitStep<Real>> {
public:
    /// `tiled`: threads read neighbours from a tile in shared memory.
    ImplicitBackend(const KernelFamily& family, const Options& options, bool tiled)
        : ParticleBackend<Real, ImplicitStep<Real>>(family),
          options_(options),
          shape_(BlockShape::parse(options.tuning.at("block"))),
          registers_(options.tuning.at("registers")),
          interior_(options.tuning.at("interior")),
          launches_all_(options.tuning.at("launched") == "all"),
          tiled_(tiled),
          resting_(options) {}

    void upload(const Problem& problem, const State& state) override {
        this->template begin_upload<Real>();
        const Lattice& lattice = problem.lattice;
        const Placement placement = place_on_grid(lattice);
        const std::vector<BlockOrigin> origins =
            launches_all_ ? std::vector<BlockOrigin>{} : occupied_blocks(lattice, shape_);
        origins_.upload(origins, this->stream());
        compliance_.upload(pack_compliance<Real>(problem, placement), this->stream());

        typename ImplicitBackend::Launch launch;
        launch.block = dim3(unsigned(shape_.x), unsigned(shape_.y), unsigned(shape_.z));
        launch.grid = !origins.empty() ? dim3(unsigned(origins.size()))
                                       : dim3(blocks_for(std::size_t(lattice.dims.x), launch.block.x),
                                              blocks_for(std::size_t(lattice.dims.y), launch.block.y),
                                              blocks_for(std::size_t(lattice.dims.z), launch.block.z));
        resting_.upload(problem, state, shape_, this->stream());
        launch.kernel = this->kernel(source(problem, launch.grid, registers_for(launch.grid)));
        if (tiled_) launch.shared_bytes = tile_bytes();
        // The kernel that leaves out blocks at rest is compiled only if the run may use it. Graphs that hold
        // the previous kernel are dropped before that kernel is.
        if (resting_.may_check()) {
            std::shared_ptr<const Kernel> kernel =
                this->kernel(source(problem, launch.grid, resting_registers, resting_.terms()));
            if (kernel != resting_kernel_) this->forget_graphs();
            resting_kernel_ = std::move(kernel);
            resting_kernel_->allow_shared(launch.shared_bytes);
            // No more blocks of threads are launched than registers let run at once: only the device knows
            // how many blocks of voxels have to be stepped, and each block of threads steps several of these
            // in turn.
            const int at_once = this->device().multiprocessors *
                                this->blocks_with(resting_registers, shape_.x * shape_.y * shape_.z);
            resting_grid_ = dim3(unsigned(std::min(resting_.blocks(), std::size_t(at_once))));
        }
        launch.step = make_implicit_step<Real>(problem, placement, this->formulation());
        launch.step.origins = origins_.data();
        launch.step.compliance = compliance_.data();
        // `active` is set here only for resume(), which compares this step with the latest one: if the
        // buffers have moved, it finds other addresses.
        launch.step.active = resting_.active(0);
        if (!by_increments(this->formulation()))
            calibrate_rest_lengths<Real>(launch.step.rest_length, this->stream());
        this->start(problem, state, placement, lattice.mask, launch);
        // The start check finds the blocks that the first step changes. With a tool there is none: the tool's
        // forces are computed only with the first step.
        if (resting_.checks() && this->held().size() == 0) {
            launch_resting(resting_.start_check(), 0);
            resting_.start_checked(this->stream());
        }
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        this->write_masks(edit);
        resting_.wake(this->current(), this->stream());
    }

    void move_tool(const glm::dvec3& displacement) override {
        ParticleBackend<Real, ImplicitStep<Real>>::move_tool(displacement);
        resting_.wake(this->current(), this->stream());
    }

    WorkCount count_work() override {
        if (!resting_.may_check()) return {};
        const bool checks = resting_.checks();
        this->step(1);
        return {{"tiles", resting_.blocks()},
                {"tiles_stepped", checks ? resting_.blocks_stepped(this->stream()) : resting_.blocks()}};
    }

    std::optional<Choice> choice() const override {
        const dim3 grid = this->launch().grid;
        return choice_of_auto(options_, {{"interior", votes(grid) ? "vote" : "mask"},
                                         {"registers", std::to_string(registers_for(grid))},
                                         {"rest", resting_.choice()}});
    }

    StepWork step_work(const Problem& problem) const override {
        return implicit_work<Real>(problem, this->formulation());
    }

private:
    std::string refused(const Problem& problem) const override {
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        if (tiled_ && tile_bytes() > this->device().shared_bytes)
            return "a tile needs " + std::to_string(tile_bytes()) +
                   " bytes of shared memory, but a block may have at most " +
                   std::to_string(this->device().shared_bytes);
        if (launches_all_ && !fits_launch(problem.lattice, shape_))
            return "launched=all: the grid has more blocks along y or z than one launch allows; use "
                   "launched=occupied";
        if (std::string why = resting_.refused(problem.lattice, shape_); !why.empty()) return why;
        return launch_refusal<Real>(place_on_grid(problem.lattice).words, this->device(), this->family());
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return implicit_bytes<Real>(problem, shape_, this->formulation()) +
               resting_.bytes_needed(problem, shape_);
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + origins_.bytes() + part_origins_.bytes() + compliance_.bytes() +
               resting_.bytes_held();
    }

    /// A message from another part has moved particles, so the blocks around these particles have to be
    /// stepped. The next step takes all blocks, which is simpler than finding these.
    void border_written() override { resting_.wake(this->current(), this->stream()); }

    bool splits_steps() const override { return !launches_all_; }
    bool split_steps(const std::vector<std::uint32_t>& border) override {
        parts_ = part_blocks(this->problem().lattice, shape_, border);
        part_origins_.upload(parts_.blocks, this->stream());
        return parts_.count_of(StepPart::interior) > 0;
    }
    // Nothing has to be compiled: the kernel of a whole step takes any list of blocks.
    void compile_for_parts() override {}
    void enqueue_part(int reading, StepPart part, const Stream& in) override {
        const std::size_t count = parts_.count_of(part);
        if (count == 0) return;
        const auto& launch = this->launch();
        ImplicitStep<Real> step = launch.step;
        step.origins = part_origins_.data() + parts_.begin_of(part);
        this->launch_kernel(in, *launch.kernel, dim3(unsigned(count)), launch.block, launch.shared_bytes,
                            step, reading);
    }
    bool splits_next_step() const override { return !resting_.checks(); }
    /// With rest=auto, ends the search for blocks at rest, because each message over a border makes the next
    /// step take all blocks anyway (border_written()). Returns false with rest=skip, which asks for the
    /// search, and with rest=flush, whose steps have other bits.
    bool make_steps_alike() override { return resting_.stop(); }

    void rewound() override { resting_.rewind(this->stream()); }
    int kind_of_step() const override { return resting_.checks() ? 1 : 0; }
    void enqueue_step(int reading) override {
        if (!resting_.checks()) {
            ParticleBackend<Real, ImplicitStep<Real>>::enqueue_step(reading);
            return;
        }
        launch_resting(resting_.active(reading), reading);
    }
    void launch_resting(const ActiveBlocks& active, int reading) const {
        const auto& launch = this->launch();
        ImplicitStep<Real> step = launch.step;
        step.active = active;
        this->with_arguments(step, reading, [&](const auto&... arguments) {
            resting_kernel_->launch_dependent_if(this->family().dependent_launch, this->stream(),
                                                 resting_grid_, launch.block, launch.shared_bytes,
                                                 arguments...);
        });
    }
    void enqueue_steps(int count) override {
        while (count > 0) {
            const int steps = std::min(count, resting_.steps_to_decision());
            CudaBackend::enqueue_steps(steps);
            resting_.stepped(steps, this->current(), this->stream());
            count -= steps;
        }
    }

    std::size_t tile_bytes() const {
        const std::size_t axes = this->formulation() == Formulation::compensated ? 6 : 3;
        return axes * 3 * std::size_t(shape_.x + 2) * std::size_t(shape_.y + 2) * sizeof(Real);
    }

    KernelSource source(const Problem& problem, dim3 grid, int registers,
                        std::uint32_t more_terms = 0) const {
        KernelSource source = this->family().source(
            tiled_ ? "tile.cu" : "implicit.cu", problem, max_threads,
            this->blocks_with(registers, max_threads),
            (votes(grid) ? term_full_stencil : 0) | (interior_ == "bits" ? term_bit_by_bit : 0) | more_terms);
        if (tiled_) {
            source.macros["THREADS"] = std::to_string(shape_.x * shape_.y);
            source.macros["WIDTH"] = std::to_string(shape_.x);
            source.macros["HEIGHT"] = std::to_string(shape_.y);
        }
        return source;
    }

    std::size_t threads_of(dim3 grid) const {
        return std::size_t(grid.x) * grid.y * grid.z * std::size_t(shape_.x * shape_.y * shape_.z);
    }

    int registers_for(dim3 grid) const {
        // Chosen by measurements of box 160^3 and 256^3 (study `tuning`).
        constexpr RegisterChoice choice{
            .on_positions = 32, .displacement = 40, .increment = 48, .compensated = 64};
        return ParticleBackend<Real, ImplicitStep<Real>>::registers_for(registers_, threads_of(grid),
                                                                        max_threads, {128, 64}, choice);
    }

    /// Whether warps vote on skipping the masks (tuning `interior`). With `auto` they do not vote if all
    /// threads run at once: a step then takes as long as one thread waits for memory, and with a vote the
    /// fetches of neighbours would wait for the mask.
    bool votes(dim3 grid) const {
        return interior_ == "auto" ? !this->run_at_once(threads_of(grid), 64, max_threads)
                                   : interior_ == "vote";
    }

    /// Registers per thread in float32 of the kernel that leaves out blocks at rest. Its threads take several
    /// blocks each and keep the old state to compare it with the new one. With 32 registers, stepping all
    /// blocks of a large box took four times as long.
    static constexpr int resting_registers = 64;

    const Options options_;
    const BlockShape shape_;
    const std::string registers_;
    const std::string interior_;
    const bool launches_all_;
    const bool tiled_;
    Resting resting_;
    std::shared_ptr<const Kernel> resting_kernel_;
    dim3 resting_grid_;
    Buffer<BlockOrigin> origins_;
    BlockParts<BlockOrigin> parts_;  ///< the blocks of each of a split step's two launches
    Buffer<BlockOrigin> part_origins_;
    Buffer<Real> compliance_;
};

}  // namespace

BackendEntry implicit_entry(const std::string& name, const std::string& summary, const TuningValues& fetches,
                            const TuningValues& blocks) {
    const bool tiled = fetches.empty();
    const auto make = [tiled](const Options& options) {
        // The tile in shared memory takes the place of a cache, so it is filled by loads past L1.
        const KernelFamily family(options, tiled ? Fetch::past_l1 : fetch_path(options.tuning.at("fetch")));
        return make_by_precision<ImplicitBackend>(options, family, options, tiled);
    };
    const auto bytes = [](const Problem& problem, const Options& options) {
        const BlockShape shape = BlockShape::parse(options.tuning.at("block"));
        return by_precision(options.precision, [&]<class Real>(Real) {
            return implicit_bytes<Real>(problem, shape, options.formulation);
        });
    };
    std::map<std::string, TuningValues> own = {
        // Whether a step is launched while the step before it still runs.
        {"dependent_launch", {"off", "on"}},
        {"block", blocks},
        // Registers per thread in float32; in float64 a thread has twice as many. All threads of a small
        // lattice run at once, and a step takes as long as one thread waits for memory: with many registers
        // that thread fetches all neighbours of a group at once. On a large lattice other threads run
        // meanwhile, and few registers make room for more of them. `auto` decides by the number of threads
        // and the formulation.
        {"registers", {"auto", "32", "40", "48", "64", "128"}},
        // How a thread treats neighbours that may not exist. `mask`: it fetches all neighbours, and drops
        // those whose mask bit is not set. `vote`: like `mask`, but a warp skips the masks if all its
        // particles have all neighbours. `bits`: it fetches a neighbour only after testing its bit, as in the
        // paper. `auto`: `mask` or `vote`, by the number of threads.
        {"interior", {"auto", "mask", "vote", "bits"}},
        // Whether steps are replayed from a graph, or launched one by one, as in the paper.
        {"graph", {"on", "off"}},
        // Which blocks of voxels are launched: those with a particle, or all, with one thread per voxel,
        // active or not, as in the paper.
        {"launched", {"occupied", "all"}},
        // What a step does with blocks at rest (resting.h).
        {"rest", {"auto", "step", "skip", "flush"}}};
    if (!tiled) own["fetch"] = fetches;
    return {.name = name,
            .api = "cuda",
            .addressing = Addressing::by_grid,
            .summary = summary,
            .precisions = {Precision::float32, Precision::float64},
            .formulations = every_formulation,
            .tuning = tuning(own),
            .make = make,
            .bytes = bytes,
            .refused_options = refused_rest};
}

}  // namespace voxspring::cuda
