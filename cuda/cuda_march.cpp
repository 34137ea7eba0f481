// The grid plane by plane: blocks march along z over tiles of columns, positions in structure of arrays,
// windows filled by the tensor copy engine (kernels/march.h).
#include <cuda.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/layout/march_layout.h"
#include "backends/layout/march_plan.h"
#include "backends/layout/march_work.h"
#include "backends/layout/particles.h"
#include "backends/layout/springs.h"
#include "backends/physics/addressing.h"
#include "backends/registry.h"
#include "cuda/common/cuda_backend.h"
#include "cuda/common/divergence_check.h"
#include "cuda/common/measure.h"

namespace voxspring::cuda {
namespace {

constexpr int min_architecture = 90;  // has the copy engine

/// Those that the tuning parameter allows; none where a precision has not the one that it names.
std::vector<MarchTile> tiles_of(const std::string& tuned, Precision precision) {
    std::vector<MarchTile> tiles = march_tiles(precision);
    if (tuned != "auto") std::erase_if(tiles, [&](const MarchTile& tile) { return tile.name != tuned; });
    return tiles;
}

MarchDevice march_device(const Device& device) {
    return {.multiprocessors = device.multiprocessors(),
            .threads = device.threads_per_multiprocessor(),
            .shared_bytes = device.multiprocessor_shared_bytes(),
            .reserved_bytes = device.reserved_shared_bytes(),
            .block_shared_bytes = device.shared_bytes(),
            .hertz = 1e6 * device.sm_mhz(),
            .bytes_per_second = device.memory_bytes_per_second(),
            .cache_bytes = double(device.cache_bytes())};
}

/// Of the largest of these.
std::uint64_t max_plan_bytes(const Lattice& lattice, const std::vector<MarchTile>& tiles) {
    std::uint64_t most = 0;
    for (const MarchTile& tile : tiles) most = std::max(most, max_plan_bytes(lattice, tile.shape));
    return most;
}

std::uint64_t state_bytes(const SoaStrides& axes, Formulation formulation, std::size_t real_bytes) {
    return (by_increments(formulation) ? 3 : 2) * axes.size() * real_bytes;
}

decltype(&cuTensorMapEncodeTiled) encode_function() {
    void* function = nullptr;
    cudaDriverEntryPointQueryResult found{};
    // What it was when it came.
    constexpr unsigned version = 12000;
    check(cudaGetDriverEntryPointByVersion("cuTensorMapEncodeTiled", &function, version, cudaEnableDefault,
                                           &found));
    if (found != cudaDriverEntryPointSuccess || function == nullptr)
        throw DeviceError("the driver has no cuTensorMapEncodeTiled");
    return reinterpret_cast<decltype(&cuTensorMapEncodeTiled)>(function);
}

/// Boxes of width x height voxels of one plane and all three axes of the vectors at `data`.
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
        throw DeviceError("cuTensorMapEncodeTiled: CUresult " + std::to_string(int(result)));
    TensorMap map{};
    static_assert(sizeof map == sizeof encoded);
    std::memcpy(&map, &encoded, sizeof map);
    return map;
}

/// The kernel for a scene.
KernelSource march_source(const Problem& problem, Formulation formulation, const MarchTile& tile,
                          Precision precision) {
    const MarchShape& s = tile.shape;
    std::string shape;
    for (const int number : {s.rows, s.lanes, s.wide, s.high, s.planes, s.befores})
        shape += (shape.empty() ? "" : ",") + std::to_string(number);
    // Pins are in the words.
    const std::uint32_t terms = terms_of(problem) & (term_damping | term_gravity);
    return {"march.cu",
            {{"REAL", precision == Precision::float32 ? "float" : "double"},
             {"FETCH", "PastL1"},  // of kernels that fetch words
             {"TERMS", "KernelTerms<Formulation::" + to_string(formulation) + "," +
                           std::to_string(problem.group_bits) + "u," + std::to_string(terms) + "u,false>"},
             {"THREADS", std::to_string(s.threads())},
             {"BLOCKS", std::to_string(tile.blocks)},
             {"SHAPE", "MarchShape{" + shape + "}"},
             {"EQUAL_EDGES", equal_edges(problem, formulation) ? "true" : "false"}}};
}

template <class Real>
class MarchBackend final : public CudaBackend {
public:
    explicit MarchBackend(const Options& options)
        : formulation_(options.formulation),
          tuned_(options.tuning.at("tile")),
          tiles_(tiles_of(tuned_, precision)) {}

    void upload(const Problem& problem, const State& state) override {
        this->begin_upload();
        this->set_problem(problem);
        MarchPlan plan = planned(problem, tiles_);
        tile_ = plan.tile;
        axes_ = march_strides(problem.lattice, sizeof(Real));
        {
            const MarchState<Real> packed = pack_march<Real>(problem, state, formulation_);
            positions_[0].upload(packed.current, this->stream());
            if (by_increments(formulation_)) {
                // A step writes every particle's u here before any reads it; what is none is zero.
                positions_[1].resize(packed.current.size());
                positions_[1].fill_with_zeros(this->stream());
                increment_.upload(packed.before, this->stream());
            } else {
                positions_[1].upload(packed.before, this->stream());
                increment_.resize(0);
            }
        }
        const MarchShape& shape = tile_.shape;
        constexpr int real = sizeof(Real);
        Launch launch = launch_;
        launch.step = make_march_step<Real>(problem, formulation_);
        if (!by_increments(formulation_))
            measure_inverse_roots<Real>(launch.step.rest_length, this->stream());
        launch.kernel = this->kernel(march_source(problem, formulation_, tile_, precision));
        launch.kernel->allow_shared(std::size_t(shape.shared_bytes(real)));
        for (std::size_t b = 0; b < 2; ++b) {
            Real* const positions = positions_[b].data();
            Real* const before = by_increments(formulation_) ? increment_.data() : positions;
            launch.windows[b] =
                tensor_map(positions, problem.lattice, axes_, shape.pitch(real), shape.height() + 2);
            launch.befores[b] = tensor_map(before, problem.lattice, axes_, shape.width(), shape.height());
        }
        resume(plan, launch);
        this->stand_at_start();
    }

    /// Masks change in place or give a warp masks that had none, so all of them are made anew.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->set_problem(edited);
        if (!edit.empty()) resume(planned(edited, {tile_}), launch_);
    }

    State download() override {
        MarchState<Real> packed;
        const auto out = [&](std::vector<Real>& values, const Buffer<Real>& buffer) {
            values.resize(buffer.size());
            buffer.download(values, this->stream());
        };
        const auto now = std::size_t(this->current());
        out(packed.current, positions_[now]);
        out(packed.before, by_increments(formulation_) ? increment_ : positions_[1 - now]);
        return unpack_march<Real>(this->problem(), packed, formulation_);
    }

    std::optional<Choice> choice() const override { return Choice{"tile=" + tile_.name, predicted_seconds_}; }

    StepWork step_work(const Problem& problem) const override {
        return march_work<Real>(problem, formulation_);
    }

private:
    static constexpr Precision precision =
        sizeof(Real) == sizeof(float) ? Precision::float32 : Precision::float64;

    MarchPlan planned(const Problem& problem, const std::vector<MarchTile>& tiles) const {
        return plan_march(problem, tiles, precision, formulation_, march_device(this->device()));
    }

    std::string refused(const Problem& problem) const override {
        if (tiles_.empty()) return "tiles of " + tuned_ + " are not for " + to_string(precision);
        const int architecture = this->device().architecture();
        if (architecture < min_architecture)
            return "compute capability " + std::to_string(architecture / 10) + "." +
                   std::to_string(architecture % 10) + " has no tensor copies, which came with 9.0";
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        if ((problem.group_bits & CORNER_BITS) != 0) return "corner springs are beyond the march's stencil";
        if (!has_inverse_lengths(problem, precision, formulation_))
            return "forces in units of rest lengths need some that are not zero";
        if (problem.has_materials()) return "the march is for one material";
        if (!problem.load.empty()) return "the march has no place for loads";
        std::size_t needed = std::numeric_limits<std::size_t>::max();
        for (const MarchTile& tile : tiles_)
            needed = std::min(needed, std::size_t(tile.shape.shared_bytes(sizeof(Real))));
        if (needed > this->device().shared_bytes())
            return "tiles of " + std::to_string(needed) + " bytes exceed the " +
                   std::to_string(this->device().shared_bytes()) + " of shared memory that a block may have";
        return {};
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return state_bytes(march_strides(problem.lattice, sizeof(Real)), formulation_, sizeof(Real)) +
               max_plan_bytes(problem.lattice, tiles_);
    }
    std::uint64_t bytes_held() const override {
        return positions_[0].bytes() + positions_[1].bytes() + increment_.bytes() + items_.bytes() +
               words_.bytes();
    }

    std::vector<StateArray> state_arrays() const override {
        return {state_array(positions_[0]), state_array(positions_[1]), state_array(increment_)};
    }

    /// What a launch is made of, besides x(t) and what is overwritten.
    struct Launch {
        std::shared_ptr<const Kernel> kernel;
        MarchStep<Real> step{};
        std::size_t items = 0;
        std::array<TensorMap, 2> windows{}, befores{};
        bool operator==(const Launch&) const = default;
    };

    /// Goes on with `launch` and a new plan.
    void resume(const MarchPlan& plan, Launch launch) {
        predicted_seconds_ = plan.seconds;
        this->synchronize();  // with what reads the plan until now
        items_.upload(plan.items, this->stream());
        words_.upload(plan.words, this->stream());
        launch.step.items = items_.data();
        launch.step.words = words_.data();
        launch.items = plan.items.size();
        if (launch == launch_) return;
        launch_ = launch;
        this->forget_graphs();
    }

    void enqueue_step(int reading) override {
        const auto from = std::size_t(reading), to = std::size_t(1 - reading);
        const MarchOutput<Real> output{positions_[to].data(), increment_.data()};
        launch_.kernel->launch(this->stream(), dim3(unsigned(launch_.items)),
                               dim3(unsigned(tile_.shape.threads())),
                               std::size_t(tile_.shape.shared_bytes(sizeof(Real))), launch_.step,
                               launch_.windows[from], launch_.befores[to], output);
    }

    void enqueue_divergence_check(const DivergenceCheck& parameters, FirstDivergence* first) override {
        const auto now = std::size_t(this->current());
        launch_divergence_check_on_axes(
            positions_[now].data(), by_increments(formulation_) ? nullptr : positions_[1 - now].data(),
            increment_.data(), axes_.axis, axes_.axis, parameters, first, this->stream());
    }

    const Formulation formulation_;
    const std::string tuned_;
    const std::vector<MarchTile> tiles_;  ///< to choose from
    MarchTile tile_{};
    double predicted_seconds_ = 0;
    SoaStrides axes_;
    std::array<Buffer<Real>, 2> positions_;
    Buffer<Real> increment_;
    Buffer<MarchItem> items_;
    Buffer<std::uint64_t> words_;
    Launch launch_;
};

/// Device memory, at most.
std::uint64_t march_bytes(const Problem& problem, const Options& options) {
    const std::size_t real = options.precision == Precision::float32 ? sizeof(float) : sizeof(double);
    return state_bytes(march_strides(problem.lattice, real), options.formulation, real) +
           max_plan_bytes(problem.lattice, tiles_of(options.tuning.at("tile"), options.precision));
}

std::unique_ptr<Backend> make_march(const Options& options) {
    if (options.precision == Precision::float32) return std::make_unique<MarchBackend<float>>(options);
    return std::make_unique<MarchBackend<double>>(options);
}

/// Tiles by their width and height in particles, the default first. auto: whichever plan_march() takes.
const TuningValues tiles = {"auto",  "32x20", "64x4",   "64x8",   "64x16", "64x20",
                            "64x24", "128x8", "128x16", "128x20", "128x24"};

const Registered entry({
    .name = "cuda_march",
    .summary = "Blocks march along z, two to four columns a thread, planes copied ahead into shared memory; "
               "one material, face and edge springs.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::increment, Formulation::position, Formulation::displacement},
    .tuning = {{"tile", tiles}},
    .make = make_march,
    .bytes = march_bytes,
});

}  // namespace
}  // namespace voxspring::cuda
