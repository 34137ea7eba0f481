// Explicit addressing of tiles: a list of active tiles of 2 x 2 x 2 voxels, with one or two threads per tile.
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "backends/by_precision.h"
#include "backends/layout/blocks.h"
#include "backends/layout/tile_lists.h"
#include "backends/registry.h"
#include "cuda/common/axes_backend.h"
#include "cuda/common/edit.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block_threads = 128;
/// Blocks per multiprocessor in float32 where each thread steps a whole tile.
constexpr int whole_tile_blocks = 4;

/// An upper bound of the device memory.
template <class Real>
std::uint64_t needed_bytes(const Problem& problem, Formulation formulation) {
    return tile_bytes<Real>(problem, block_threads, by_increments(formulation) ? 3 : 2);
}

template <class Real>
class TilesBackend final : public AxesBackend<Real> {
public:
    explicit TilesBackend(const Options& options)
        : AxesBackend<Real>(options.formulation),
          tuned_threads_(options.tuning.at("threads")),
          dependent_(this->device().has_dependent_launches()) {}

    void upload(const Problem& problem, const State& state) override {
        this->template begin_upload<Real>();
        this->set_problem(problem);
        const ActiveTiles active(problem);
        tile_threads_ = tuned_threads_ == "auto" ? threads_per_tile(active.count, resident_tiles())
                                                 : unsigned(std::stoi(tuned_threads_));
        lists_.emplace(problem, active, block_threads / tile_threads_);
        this->upload_state(problem, state);
        rows_.upload(lists_->rows(), this->stream());
        masks_.upload(lists_->masks(), this->stream());
        step_ = {};
        static_cast<MarchStep<Real>&>(step_) = this->measured_step(problem);
        step_.rows = rows_.data();
        step_.masks = masks_.data();
        kernel_ = this->kernel(source(problem));
        this->forget_graphs();
        this->reset_to_step_zero();
    }

    /// Rewrites only the masks of the tiles whose springs the edit changes.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        if (edit.empty()) return;
        const std::vector<EditedWord> changed = lists_->edit(edit);
        launch_for_each(*support_kernels<Real>().write_bare_words, changed.size(), this->stream(),
                        reinterpret_cast<std::uint32_t*>(masks_.data()),
                        staging_.send(std::span(changed), this->stream()), changed.size());
    }

    StepWork step_work(const Problem& problem) const override {
        return tile_work<Real>(problem, this->formulation());
    }

    std::optional<Choice> choice() const override {
        return Choice{"threads=" + std::to_string(tile_threads_)};
    }

private:
    using AxesBackend<Real>::precision;

    SoaPlaces places() const override {
        return {lists_->elements(), tile_axis, [this](std::size_t i) {
                    const Lattice& lattice = this->problem().lattice;
                    return lists_->element(lattice.coordinates(lattice.voxel[i]));
                }};
    }

    KernelSource source(const Problem& problem) const {
        KernelSource source{"tiles.cu", class_macros(problem, this->formulation(), precision)};
        source.macros["THREADS"] = std::to_string(block_threads);
        source.macros["TILE_THREADS"] = std::to_string(tile_threads_);
        // In float32 a thread has 128 registers if it steps a whole tile, and 96 if it steps half of one; in
        // float64 it has 255. With fewer registers the particles do not fit. With more, too few loads are in
        // flight.
        const int float32_blocks = tile_threads_ == 1 ? whole_tile_blocks : 5;
        source.macros["BLOCKS"] = std::to_string(precision == Precision::float32 ? float32_blocks : 2);
        if (dependent_) source.macros["DEPENDENT_LAUNCH"] = "1";
        return source;
    }

    template <class... Blocks>
    void launch(const Kernel& kernel, const Stream& in, std::size_t blocks, int reading, bool dependent,
                Blocks... listed) const {
        const Real* const at = this->positions(std::size_t(reading));
        const MarchOutput<Real> output{this->positions(std::size_t(1 - reading)), this->increment()};
        const dim3 grid{unsigned(blocks)}, block{block_threads};
        kernel.launch_dependent_if(dependent, in, grid, block, 0, step_, at, output, reading == 1, listed...);
    }
    void enqueue_step(int reading) override {
        launch(*kernel_, this->stream(), lists_->blocks(), reading, dependent_);
    }

    bool gives_borders() const override { return true; }
    bool splits_steps() const override { return true; }
    bool split_steps(const std::vector<std::uint32_t>& border) override {
        const Lattice& lattice = this->problem().lattice;
        std::vector<std::uint32_t> tiles;
        for (const std::uint32_t i : border)
            tiles.push_back(lists_->tile_of(lattice.coordinates(lattice.voxel[i])));
        const unsigned block_tiles = block_threads / tile_threads_;
        parts_ = part_blocks(std::size_t(lists_->blocks()) * block_tiles, block_tiles, tiles);
        blocks_.upload(parts_.blocks, this->stream());
        KernelSource listed = source(this->problem());
        listed.macros["LISTED_BLOCKS"] = "1";
        part_kernel_ = this->kernel(listed);
        return parts_.count_of(StepPart::interior) > 0;
    }
    void enqueue_part(int reading, StepPart part, const Stream& in) override {
        const std::size_t count = parts_.count_of(part);
        if (count == 0) return;
        const std::uint32_t* const blocks = blocks_.data() + parts_.begin_of(part);
        // This launch is not a dependent one, which could begin early: a launch of a split step also waits
        // for work in another stream.
        launch(*part_kernel_, in, count, reading, false, blocks);
    }

    std::string refused(const Problem& problem) const override {
        if (std::string why = class_refusal(problem, precision, this->formulation(), "tiles");
            !why.empty() || problem.ghosts.empty())
            return why;
        return border_index_refusal(tile_elements(ActiveTiles(problem), block_threads));
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return needed_bytes<Real>(problem, this->formulation());
    }
    std::uint64_t bytes_held() const override {
        return this->state_bytes_held() + rows_.bytes() + masks_.bytes() + staging_.bytes() + blocks_.bytes();
    }

    /// How many tiles the card steps at once in float32 if each thread steps one. Float64, in which the card
    /// has room for half as many, chooses by this number as well: one thread and two were timed in float32
    /// alone.
    std::size_t resident_tiles() const {
        return std::size_t(this->device().multiprocessors) * whole_tile_blocks * block_threads;
    }

    const std::string tuned_threads_;
    unsigned tile_threads_ = 1;
    const bool dependent_;  ///< whether a step is launched while the previous one still runs
    std::optional<TileLists> lists_;
    TileStep<Real> step_{};
    std::shared_ptr<const Kernel> kernel_;
    Buffer<TileRow> rows_;
    Buffer<TileMask> masks_;
    Staging<EditedWord> staging_;
    // For split steps, which have two launches: the border, and the interior.
    std::shared_ptr<const Kernel> part_kernel_;
    BlockParts<std::uint32_t> parts_;
    Buffer<std::uint32_t> blocks_;
};

const Registered entry({
    .name = "cuda_tiles",
    .api = "cuda",
    .summary =
        "One or two threads per active tile of 2x2x2 voxels, from a list with neighbours per row of tiles; "
        "springs within a thread's share are computed once. Only one material, face and edge springs.",
    .strength = "only active tiles are stepped, each by one or two threads",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement},
    .tuning = {{"threads", {"auto", "1", "2"}}},
    .make = [](const Options& options) { return make_by_precision<TilesBackend>(options, options); },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return by_precision(options.precision, [&]<class Real>(Real) {
                return needed_bytes<Real>(problem, options.formulation);
            });
        },
});

}  // namespace
}  // namespace voxspring::cuda
