// The grid is stepped plane by plane: blocks march along z over tiles of columns. Positions are a structure
// of arrays. The tensor copy engine or the block's threads copy windows of them to shared memory
// (kernels/march.h).
#include <cuda.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/by_precision.h"
#include "backends/layout/march_layout.h"
#include "backends/layout/march_plan.h"
#include "backends/layout/work.h"
#include "backends/registry.h"
#include "cuda/common/axes_backend.h"

namespace voxspring::cuda {
namespace {

constexpr int first_with_async_copies = 80, first_with_tensor_copies = 90;

/// The tiles that `tuned`, the value of the tuning parameter `tile`, allows. Empty if it names a tile that is
/// not offered in `precision`.
std::vector<MarchTile> tiles_of(const std::string& tuned, Precision precision) {
    std::vector<MarchTile> tiles = march_tiles(precision);
    if (tuned != "auto") std::erase_if(tiles, [&](const MarchTile& tile) { return tile.name != tuned; });
    return tiles;
}

/// An upper bound of the bytes of a plan with any of `tiles` for a body that is not cut into parts.
std::uint64_t max_plan_bytes(const Lattice& lattice, const std::vector<MarchTile>& tiles) {
    std::uint64_t most = 0;
    for (const MarchTile& tile : tiles) most = std::max(most, max_plan_bytes(lattice, tile.shape));
    return most;
}

decltype(&cuTensorMapEncodeTiled) encode_function() {
    void* function = nullptr;
    cudaDriverEntryPointQueryResult found{};
    // The CUDA version that introduced the function.
    constexpr unsigned version = 12000;
    check(cudaGetDriverEntryPointByVersion("cuTensorMapEncodeTiled", &function, version, cudaEnableDefault,
                                           &found));
    if (found != cudaDriverEntryPointSuccess || function == nullptr)
        throw DeviceError("the driver has no cuTensorMapEncodeTiled");
    return reinterpret_cast<decltype(&cuTensorMapEncodeTiled)>(function);
}

/// A tensor map of `data`. By this map one copy fetches a box of width x height voxels of one plane, for all
/// three axes.
template <class Real>
TensorMap tensor_map(Real* data, const Lattice& lattice, const SoaStrides& axes, int width, int height) {
    static const auto encode = encode_function();
    constexpr auto type =
        sizeof(Real) == sizeof(float) ? CU_TENSOR_MAP_DATA_TYPE_FLOAT32 : CU_TENSOR_MAP_DATA_TYPE_FLOAT64;
    const std::array<cuuint64_t, 4> extents = {cuuint64_t(lattice.dims.x), cuuint64_t(lattice.dims.y),
                                               cuuint64_t(lattice.dims.z), 3};
    const std::array<cuuint64_t, 3> strides = {axes.row * sizeof(Real), axes.plane * sizeof(Real),
                                               axes.axis * sizeof(Real)};
    const std::array<cuuint32_t, 4> box = {cuuint32_t(width), cuuint32_t(height), 1, 3};
    const std::array<cuuint32_t, 4> every = {1, 1, 1, 1};
    CUtensorMap encoded;
    const CUresult result =
        encode(&encoded, type, cuuint32_t(extents.size()), data, extents.data(), strides.data(), box.data(),
               every.data(), CU_TENSOR_MAP_INTERLEAVE_NONE, CU_TENSOR_MAP_SWIZZLE_NONE,
               CU_TENSOR_MAP_L2_PROMOTION_L2_256B, CU_TENSOR_MAP_FLOAT_OOB_FILL_NONE);
    if (result != CUDA_SUCCESS)
        throw DeviceError("cuTensorMapEncodeTiled failed with CUresult " + std::to_string(int(result)));
    TensorMap map{};
    static_assert(sizeof map == sizeof encoded);
    std::memcpy(&map, &encoded, sizeof map);
    return map;
}

/// The source of the march kernel for a scene. The compiler limits the registers per thread so that `blocks`
/// blocks fit on a multiprocessor.
KernelSource march_source(const Problem& problem, Formulation formulation, const MarchTile& tile,
                          Precision precision, int blocks) {
    const MarchShape& s = tile.shape;
    std::string shape;
    for (const int number : {s.rows, s.lanes, s.wide, s.high, s.planes, s.previous_windows})
        shape += (shape.empty() ? "" : ",") + std::to_string(number);
    KernelSource source{"march.cu", class_macros(problem, formulation, precision)};
    source.macros["THREADS"] = std::to_string(s.threads());
    source.macros["BLOCKS"] = std::to_string(blocks);
    source.macros["SHAPE"] = "MarchShape{" + shape + "}";
    return source;
}

template <class Real>
class MarchBackend final : public AxesBackend<Real> {
public:
    explicit MarchBackend(const Options& options)
        : AxesBackend<Real>(options.formulation),
          tuned_(options.tuning.at("tile")),
          tiles_(tiles_of(tuned_, precision)),
          chooses_copies_(options.tuning.at("copies") == "auto"),
          tensor_copies_(chooses_copies_ && this->device().architecture >= first_with_tensor_copies) {}

    void upload(const Problem& problem, const State& state) override {
        this->template begin_upload<Real>();
        this->set_problem(problem);
        interior_ = {};
        MarchPlan plan = planned(problem, tiles_);
        tile_ = plan.tile;
        this->upload_state(problem, state);
        const MarchShape& shape = tile_.shape;
        constexpr int real = sizeof(Real);
        Launch launch = launch_;
        launch.step = this->measured_step(problem);
        KernelSource source = march_source(problem, this->formulation(), tile_, precision,
                                           resident_blocks(tile_, precision, plan_device()));
        if (tensor_copies_) {
            source.macros["KEPT_PLANES"] = std::to_string(plan.kept_planes);
        } else {
            source.macros["ASYNC_COPIES"] = "1";
        }
        launch.kernel = this->kernel(source);
        launch.kernel->allow_shared(std::size_t(shape.shared_bytes(real)));
        const SoaStrides axes = march_strides(problem.lattice, sizeof(Real));
        for (std::size_t b = 0; b < 2; ++b) {
            Real* const positions = this->positions(b);
            Real* const before = by_increments(this->formulation()) ? this->increment() : positions;
            launch.arrays[b] = {positions, before};
            if (!tensor_copies_) continue;
            launch.windows[b] =
                tensor_map(positions, problem.lattice, axes, shape.pitch(real), shape.height() + 2);
            launch.previous_windows[b] =
                tensor_map(before, problem.lattice, axes, shape.width(), shape.height());
        }
        resume(plan, launch);
        this->reset_to_step_zero();
    }

    /// Makes all items and masks anew, since an edit may give masks to a warp that had none.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        if (!edit.empty()) resume(planned(edited, {tile_}), launch_);
    }

    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        check_border(particles);
        return AxesBackend<Real>::border(particles);
    }
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& borders,
                                                  const std::string& way) override {
        for (const SharedParticles& shared : borders) {
            check_border(shared.sent);
            check_border(shared.received);
        }
        return AxesBackend<Real>::device_borders(borders, way);
    }

    std::optional<Choice> choice() const override {
        const std::string copies = tensor_copies_ ? "copies=tensor," : "copies=async,";
        return Choice{(chooses_copies_ ? copies : "") + "tile=" + tile_.name, predicted_seconds_};
    }

    StepWork step_work(const Problem& problem) const override {
        return march_work<Real>(problem, this->formulation());
    }

private:
    using AxesBackend<Real>::precision;

    bool gives_borders() const override { return true; }
    /// Throws Unavailable unless the particles lie in one plane of constant z and the lattice has several
    /// such planes. A thread sums forces by pairs of columns and of rows. In parts that are cut across x or y
    /// these pairs, and so the bits of the sums, could differ from those of the whole body.
    void check_border(const std::vector<std::uint32_t>& particles) const {
        const Lattice& lattice = this->problem().lattice;
        const auto plane = [&](std::uint32_t i) { return lattice.coordinates(lattice.voxel[i]).z; };
        for (const std::uint32_t i : particles) {
            if (lattice.dims.z == 1 || plane(i) != plane(particles.front()))
                throw Unavailable(
                    "cuda_march steps the parts of a body with the bits of the whole body only if all cuts "
                    "are across z");
        }
    }

    MarchPlan planned(const Problem& problem, const std::vector<MarchTile>& tiles) const {
        return plan_march(problem, tiles, precision, this->formulation(), plan_device(), interior_);
    }
    MarchDevice plan_device() const {
        MarchDevice device = march_device(this->device());
        device.tensor_copies = tensor_copies_;
        return device;
    }

    std::string refused(const Problem& problem) const override {
        if (tiles_.empty()) return "tile=" + tuned_ + " is not available in " + to_string(precision);
        const int architecture = this->device().architecture;
        if (architecture < first_with_async_copies)
            return "compute capability " + version_of(architecture) +
                   " has no asynchronous copies, which cuda_march needs and which came with 8.0";
        if (std::string why = class_refusal(problem, precision, this->formulation(), "the march");
            !why.empty())
            return why;
        if (!problem.ghosts.empty()) {
            std::string why = border_index_refusal(march_strides(problem.lattice, sizeof(Real)).axis);
            if (!why.empty()) return why;
        }
        std::size_t needed = std::numeric_limits<std::size_t>::max();
        for (const MarchTile& tile : tiles_)
            needed = std::min(needed, std::size_t(tile.shape.shared_bytes(sizeof(Real))));
        if (needed > this->device().shared_bytes)
            return "the smallest tile needs " + std::to_string(needed) +
                   " bytes of shared memory, but a block may have at most " +
                   std::to_string(this->device().shared_bytes);
        return {};
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return this->state_bytes(problem.lattice, this->formulation()) +
               max_plan_bytes(problem.lattice, tiles_);
    }
    std::uint64_t bytes_held() const override {
        return this->state_bytes_held() + items_.bytes() + words_.bytes();
    }

    /// The kernel, the number of its blocks (`items`), and its arguments for steps that read buffer 0 or 1.
    struct Launch {
        std::shared_ptr<const Kernel> kernel;
        MarchStep<Real> step{};
        std::size_t items = 0;
        std::size_t border_items = 0;  ///< how many items belong to borders; these come first
        std::array<MarchArrays<Real>, 2> arrays{};
        std::array<TensorMap, 2> windows{}, previous_windows{};
        bool operator==(const Launch&) const = default;
    };

    /// Makes the next steps use `launch` with the items and masks of `plan`.
    void resume(const MarchPlan& plan, Launch launch) {
        predicted_seconds_ = plan.seconds;
        this->synchronize();  // enqueued steps may still read the old plan
        items_.upload(plan.items, this->stream());
        words_.upload(plan.words, this->stream());
        launch.step.items = items_.data();
        launch.step.words = words_.data();
        launch.items = plan.items.size();
        launch.border_items = plan.border_items;
        if (launch == launch_) return;
        launch_ = launch;
        this->forget_graphs();
    }

    void enqueue_step(int reading) override { enqueue_items(reading, 0, launch_.items, this->stream()); }
    void enqueue_items(int reading, std::size_t begin, std::size_t end, const Stream& in) const {
        if (begin == end) return;
        const auto from = std::size_t(reading), to = std::size_t(1 - reading);
        const MarchOutput<Real> output{this->positions(to), this->increment()};
        MarchStep<Real> step = launch_.step;
        step.items += begin;
        const auto enqueue = [&](const auto&... read) {
            launch_.kernel->launch(in, dim3(unsigned(end - begin)), dim3(unsigned(tile_.shape.threads())),
                                   std::size_t(tile_.shape.shared_bytes(sizeof(Real))), step, read...,
                                   output);
        };
        if (tensor_copies_) {
            enqueue(launch_.windows[from], launch_.previous_windows[to]);
        } else {
            enqueue(MarchArrays<Real>{launch_.arrays[from].positions, launch_.arrays[to].before});
        }
    }

    bool splits_steps() const override { return true; }
    /// Makes a plan in which no item has both planes at borders and planes of the interior.
    bool split_steps(const std::vector<std::uint32_t>& border) override {
        interior_ = interior_of(this->problem(), border);
        resume(planned(this->problem(), {tile_}), launch_);
        return launch_.border_items < launch_.items;
    }
    void enqueue_part(int reading, StepPart part, const Stream& in) override {
        const bool is_border = part == StepPart::border;
        enqueue_items(reading, is_border ? 0 : launch_.border_items,
                      is_border ? launch_.border_items : launch_.items, in);
    }

    const std::string tuned_;
    const std::vector<MarchTile> tiles_;  ///< the tiles that a plan may use
    const bool chooses_copies_;
    const bool tensor_copies_;  ///< fill windows by the tensor copy engine, not by threads
    MarchTile tile_{};
    double predicted_seconds_ = 0;
    MarchInterior interior_{};
    Buffer<MarchItem> items_;
    Buffer<std::uint64_t> words_;
    Launch launch_;
};

/// An upper bound of the device memory for a body that is not cut into parts.
std::uint64_t march_bytes(const Problem& problem, const Options& options) {
    return by_precision(options.precision,
                        [&]<class Real>(Real) {
                            return AxesBackend<Real>::state_bytes(problem.lattice, options.formulation);
                        }) +
           max_plan_bytes(problem.lattice, tiles_of(options.tuning.at("tile"), options.precision));
}

/// The names of tiles: width x height in particles. With `auto`, the default, plan_march() chooses the tile.
const TuningValues tiles = {"auto", "32x20", "64x4", "64x8", "64x16", "64x20", "128x8", "128x16", "128x20"};

const Registered entry({
    .name = "cuda_march",
    .api = "cuda",
    .addressing = Addressing::by_grid,
    .summary =
        "Blocks march along z, two to four columns per thread, planes copied ahead into shared memory. "
        "Only one material, face and edge springs.",
    .strength = "each thread marches along columns, and a block reads each particle of its windows once",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement},
    // How windows are filled. `auto`: by the tensor copy engine from compute capability 9.0 on, otherwise by
    // threads. `async`: by threads.
    .tuning = {{"tile", tiles}, {"copies", {"auto", "async"}}},
    .make = [](const Options& options) { return make_by_precision<MarchBackend>(options, options); },
    .bytes = march_bytes,
});

}  // namespace
}  // namespace voxspring::cuda
