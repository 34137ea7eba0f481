// One cooperative launch for thousands of steps. Every block keeps a brick of the lattice in shared memory,
// and threads own tiles of particles in it. The positions of particles at the border of a brick go to the
// other blocks through L2.
#include <algorithm>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "backends/layout/brick_layout.h"
#include "backends/layout/work.h"
#include "backends/registry.h"
#include "cuda/common/axes_backend.h"
#include "cuda/common/edit.h"
#include "cuda/common/joint_launch.h"

namespace voxspring::cuda {
namespace {

std::string name_of(const BrickTileSize& size) {
    return std::to_string(size.x) + "x" + std::to_string(size.y) + "x" + std::to_string(size.z);
}

/// The tile size that `tuned`, the value of the tuning parameter `tile`, names. Nothing for `auto`, which
/// allows any size.
std::optional<BrickTileSize> size_of(const std::string& tuned) {
    for (const BrickTileSize& size : brick_tile_sizes()) {
        if (name_of(size) == tuned) return size;
    }
    return std::nullopt;
}

/// Bytes of the exchange, through which blocks pass the positions at their borders: two words per lattice
/// element, which successive steps use in turn.
std::uint64_t exchange_bytes(const Lattice& lattice) {
    return 2 * march_strides(lattice, sizeof(float)).axis * sizeof(TaggedPoint);
}

/// An estimate of the device memory: state, exchange, masks, points and increments. It assumes that all tiles
/// are half empty, that each particle is sent and received once, and that increments are in memory. The masks
/// of a tile have at most 20 bits per particle, 18 of them for springs, and one more word.
std::uint64_t bricks_bytes(const Problem& problem, const Options& options) {
    constexpr std::uint64_t tables = 16 + 2 * sizeof(BrickPoint);
    const std::uint64_t increments = by_increments(options.formulation) ? 2 * sizeof(Vector<float>) : 0;
    return AxesBackend<float>::state_bytes(problem.lattice, options.formulation) +
           exchange_bytes(problem.lattice) + problem.particle_count() * (tables + increments) +
           (std::uint64_t(1) << 20);
}

class BricksBackend final : public AxesBackend<float> {
public:
    explicit BricksBackend(const Options& options)
        : AxesBackend(options.formulation),
          options_(options),
          size_(size_of(options.tuning.at("tile"))),
          joint_(device().ends_long_kernels) {}

    void upload(const Problem& problem, const State& state) override {
        begin_upload<float>();
        set_problem(problem);
        const std::optional<BrickPlan> plan = planned(problem);
        if (!plan) throw DeviceError(too_large);
        plan_ = *plan;
        layout_.emplace(problem, plan_);
        upload_state(problem, state);
        step_ = {};
        static_cast<MarchStep<float>&>(step_) = measured_step(problem);
        upload_tables(problem);
        kernel_ = kernel(source(problem));
        if (const std::string why = registers_refusal(plan_, kernel_->registers()); !why.empty())
            throw DeviceError(why);
        kernel_->allow_shared(std::size_t(plan_.shape.shared_bytes()));
        reset_to_step_zero();
    }

    /// Rewrites only the masks of the threads whose springs the edit changes.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        set_problem(edited);
        if (edit.empty()) return;
        const std::vector<EditedWord> changed = layout_->edit(edit);
        launch_for_each(*support_kernels<float>().write_bare_words, changed.size(), stream(), masks_.data(),
                        staging_.send(std::span(changed), stream()), changed.size());
    }

    std::optional<Choice> choice() const override {
        const BrickShape& s = plan_.shape;
        return Choice{"tile=" + name_of({s.tx, s.ty, s.tz}), plan_.seconds};
    }

    StepWork step_work(const Problem& problem) const override {
        return without_traffic(march_work<float>(problem, formulation()));
    }

private:
    static constexpr const char* too_large =
        "the body does not fit into the shared memory and registers of the device's multiprocessors";

    std::optional<BrickPlan> planned(const Problem& problem) const {
        if (latest_ && latest_->dims == problem.lattice.dims && latest_->voxel == problem.lattice.voxel)
            return latest_->plan;
        latest_ = {problem.lattice.dims, problem.lattice.voxel,
                   plan_bricks(problem, formulation(), march_device(device()),
                               moves_registers(device().architecture), size_)};
        return latest_->plan;
    }

    KernelSource source(const Problem& problem) const {
        const BrickShape& s = plan_.shape;
        KernelSource source{"brick.cu", class_macros(problem, formulation(), precision),
                            plan_.lane_registers > 0};
        std::string shape;
        for (const int number : {s.tx, s.ty, s.tz, s.wx, s.wy, s.wz, int(s.both), s.row_pad, s.plane_pad})
            shape += (shape.empty() ? "" : ",") + std::to_string(number);
        source.macros["SHAPE"] = "BrickShape{" + shape + "}";
        source.macros["THREADS"] = std::to_string(s.lanes() + plan_.pollers);
        source.macros["BLOCKS"] = "1";
        source.macros["POLLERS"] = std::to_string(plan_.pollers);
        source.macros["POLLERS_SEND"] = plan_.pollers_send ? "1" : "0";
        source.macros["SENT_ROUNDS"] = std::to_string(layout_->sent().rounds);
        source.macros["ROUNDS"] = std::to_string(layout_->received().rounds);
        // Code without masks was measured to make a step 7% shorter where threads have 3 particles, but up to
        // 4% longer where they have 8 or 18. If some blocks need masks, such code gains nothing, because each
        // block waits for the slowest one.
        const bool has_plain_code = s.tile() <= 4 && layout_->all_plain();
        source.macros["PLAIN_BLOCKS"] = has_plain_code ? "1" : "0";
        source.macros["INCREMENTS_IN_MEMORY"] = plan_.increments_in_memory ? "true" : "false";
        source.macros["LANE_REGISTERS"] = std::to_string(plan_.lane_registers);
        source.macros["POLLER_REGISTERS"] = std::to_string(plan_.poller_registers);
        return source;
    }

    void upload_tables(const Problem& problem) {
        masks_.upload(layout_->masks(), stream());
        sent_.upload(layout_->sent().points, stream());
        received_.upload(layout_->received().points, stream());
        blocks_.upload(layout_->blocks(), stream());
        exchange_.resize(exchange_bytes(problem.lattice) / sizeof(TaggedPoint));
        exchange_.fill_with_zeros(stream());
        increments_.resize(plan_.increments_in_memory
                               ? std::size_t(layout_->lane_count()) * 3 * std::size_t(plan_.shape.tile())
                               : 0);
        joint_.start_anew(stream());
        step_.blocks = blocks_.data();
        step_.masks = masks_.data();
        step_.lane_count = layout_->lane_count();
        step_.sent = sent_.data();
        step_.received = received_.data();
        step_.exchange = exchange_.data();
        step_.increments = increments_.data();
        step_.wait = joint_.wait_limit();
    }
    void enqueue_steps(int count) override {
        float* const before = by_increments(formulation()) ? increment() : positions(1);
        joint_.enqueue(
            count, longest_joint_launch(monitored()), stream(),
            [&](int steps, std::uint32_t tag, std::uint32_t launches) {
                kernel_->launch_together(stream(), dim3(unsigned(layout_->blocks().size())),
                                         dim3(unsigned(plan_.shape.lanes() + plan_.pollers)),
                                         std::size_t(plan_.shape.shared_bytes()), step_, positions(0), before,
                                         steps, tag, launches);
            },
            [&](int steps) { stepped(steps); });
    }
    void enqueue_step(int /*reading*/) override {}  // enqueue_steps() enqueues all steps together

    std::string refused(const Problem& problem) const override {
        if (std::string why = class_refusal(problem, precision, formulation(), "bricks"); !why.empty())
            return why;
        if (!device().launches_together) return "the device has no cooperative launches, which bricks need";
        return planned(problem) ? "" : too_large;
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return bricks_bytes(problem, options_);
    }
    std::uint64_t bytes_held() const override {
        return state_bytes_held() + masks_.bytes() + sent_.bytes() + received_.bytes() + blocks_.bytes() +
               exchange_.bytes() + increments_.bytes() + joint_.bytes() + staging_.bytes();
    }
    std::string failure_note() const override { return joint_.failure_note("brick"); }

    const Options options_;
    const std::optional<BrickTileSize> size_;
    BrickPlan plan_;
    std::optional<BrickLayout> layout_;
    BrickStep step_{};
    std::shared_ptr<const Kernel> kernel_;
    Buffer<BrickBlock> blocks_;
    Buffer<std::uint32_t> masks_;
    Buffer<BrickPoint> sent_, received_;
    Buffer<TaggedPoint> exchange_;
    Buffer<float> increments_;
    Staging<EditedWord> staging_;
    JointLaunch joint_;
    /// The latest plan and the body that it was made for. refused() and the upload after refused() need the
    /// same plan.
    struct Planned {
        glm::ivec3 dims;
        std::vector<std::uint32_t> voxel;
        std::optional<BrickPlan> plan;
    };
    mutable std::optional<Planned> latest_;
};

/// Values of the tuning parameter `tile`. With `auto`, plan_bricks() chooses the size.
TuningValues tile_names() {
    TuningValues names{"auto"};
    for (const BrickTileSize& size : brick_tile_sizes()) names.push_back(name_of(size));
    return names;
}

const Registered entry({
    .name = "cuda_bricks",
    .api = "cuda",
    .addressing = Addressing::by_grid,
    .summary =
        "One launch for thousands of steps: bricks of the lattice in shared memory, one tile of "
        "particles per thread, borders of bricks through L2. Only one material, face and edge springs.",
    .strength = "shared memory of all multiprocessors holds the positions from step to step",
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement},
    .tuning = {{"tile", tile_names()}},
    .make = [](const Options& options) { return std::make_unique<BricksBackend>(options); },
    .bytes = bricks_bytes,
});

}  // namespace
}  // namespace voxspring::cuda
