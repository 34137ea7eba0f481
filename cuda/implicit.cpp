#include "cuda/implicit.h"

#include <algorithm>

#include "cuda/measure.h"
#include "cuda/particles.h"
#include "cuda/work.h"

namespace voxspring::cuda {
namespace {

constexpr int most_threads = 256;

template <class Real>
std::uint64_t implicit_bytes(const Problem& problem, BlockShape shape, Formulation formulation) {
    const Placement placement = place_on_grid(problem.lattice);
    return particle_bytes<Real>(problem, placement, formulation) +
           (problem.has_materials() ? placement.words * sizeof(Real) : 0) +
           active_blocks(problem.lattice, shape).size() * sizeof(BlockOrigin);
}

template <class Real>
class ImplicitBackend final : public ParticleBackend<Real, ImplicitStep<Real>> {
public:
    /// `tiled`: by way of shared memory.
    ImplicitBackend(const KernelFamily& family, const Options& options, bool tiled)
        : ParticleBackend<Real, ImplicitStep<Real>>(family),
          shape_(BlockShape::parse(options.tuning.at("block"))),
          registers_(options.tuning.at("registers")),
          interior_(options.tuning.at("interior")),
          tiled_(tiled) {}

    void upload(const Problem& problem, const State& state) override {
        this->synchronize();
        this->start_compiling();
        const Lattice& lattice = problem.lattice;
        const Placement placement = place_on_grid(lattice);
        const std::vector<BlockOrigin> origins = active_blocks(lattice, shape_);
        origins_.upload(origins, this->stream());
        compliance_.upload(pack_compliance<Real>(problem, placement), this->stream());

        typename ImplicitBackend::Launch launch;
        launch.block = dim3(unsigned(shape_.x), unsigned(shape_.y), unsigned(shape_.z));
        launch.grid = !origins.empty() ? dim3(unsigned(origins.size()))
                                       : dim3(blocks_for(std::size_t(lattice.dims.x), launch.block.x),
                                              blocks_for(std::size_t(lattice.dims.y), launch.block.y),
                                              blocks_for(std::size_t(lattice.dims.z), launch.block.z));
        launch.kernel = this->kernel(source(problem, launch.grid));
        if (tiled_) launch.shared_bytes = tile_bytes();
        launch.step = make_implicit_step<Real>(problem, placement, this->formulation());
        launch.step.origins = origins_.data();
        launch.step.compliance = compliance_.data();
        if (!by_increments(this->formulation()))
            measure_rest_lengths<Real>(launch.step.rest_length, this->stream());
        this->start(problem, state, placement, lattice.mask, launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->follow(edited);
        this->write_masks(edit);
    }

    StepWork step_work(const Problem& problem) const override {
        return implicit_work<Real>(problem, this->formulation());
    }

private:
    std::string refused(const Problem& problem) const override {
        if (problem.lattice.voxel_count() == 0)
            return "implicit addressing needs a regular grid and the network lies on none";
        if (!problem.springs.empty())
            return "implicit addressing has no place for springs between particles that are no grid "
                   "neighbours";
        if (tiled_ && tile_bytes() > this->device().shared_bytes())
            return "tiles of " + std::to_string(tile_bytes()) + " bytes exceed the " +
                   std::to_string(this->device().shared_bytes()) + " of shared memory that a block may have";
        return too_many_words<Real>(place_on_grid(problem.lattice).words, this->device(),
                                    this->family().fetch);
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return implicit_bytes<Real>(problem, shape_, this->formulation());
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + origins_.bytes() + compliance_.bytes();
    }

    std::size_t tile_bytes() const {
        const std::size_t axes = this->formulation() == Formulation::compensated ? 6 : 3;
        return axes * 3 * std::size_t(shape_.x + 2) * std::size_t(shape_.y + 2) * sizeof(Real);
    }

    KernelSource source(const Problem& problem, dim3 grid) const {
        KernelSource source = this->family().source(tiled_ ? "tile.cu" : "implicit.cu", problem, most_threads,
                                                    this->blocks_with(registers_for(grid), most_threads),
                                                    votes(grid) ? term_interior : 0);
        if (tiled_) {
            source.macros["THREADS"] = std::to_string(shape_.x * shape_.y);
            source.macros["WIDTH"] = std::to_string(shape_.x);
            source.macros["HEIGHT"] = std::to_string(shape_.y);
        }
        return source;
    }

    bool runs_at_once(dim3 grid, int registers) const {
        const std::size_t threads =
            std::size_t(grid.x) * grid.y * grid.z * std::size_t(shape_.x * shape_.y * shape_.z);
        return threads <= std::size_t(this->device().multiprocessors()) * most_threads *
                              std::size_t(this->blocks_with(registers, most_threads));
    }

    int registers_for(dim3 grid) const {
        if (registers_ != "auto") return std::stoi(registers_);
        for (const int many : {128, 64}) {
            if (runs_at_once(grid, many)) return many;
        }
        // What was fastest on an H200, box 160^3 and 256^3 (study `tuning`).
        switch (this->formulation()) {
            case Formulation::paper:
            case Formulation::position:
                return 32;
            case Formulation::displacement:
                return 40;
            case Formulation::increment:
                return 48;
            case Formulation::compensated:
                break;
        }
        return 64;
    }

    /// Where all threads run at once the vote is one more thing to wait for.
    bool votes(dim3 grid) const {
        return interior_ == "auto" ? !runs_at_once(grid, 64) : interior_ == "vote";
    }

    const BlockShape shape_;
    const std::string registers_;
    const std::string interior_;
    const bool tiled_;
    Buffer<BlockOrigin> origins_;
    Buffer<Real> compliance_;
};

std::unique_ptr<Backend> make(const KernelFamily& family, const Options& options, bool tiled) {
    if (family.precision == Precision::float32)
        return std::make_unique<ImplicitBackend<float>>(family, options, tiled);
    return std::make_unique<ImplicitBackend<double>>(family, options, tiled);
}

}  // namespace

std::uint64_t implicit_bytes(const Problem& problem, const Options& options) {
    const BlockShape shape = BlockShape::parse(options.tuning.at("block"));
    return options.precision == Precision::float32
               ? implicit_bytes<float>(problem, shape, options.formulation)
               : implicit_bytes<double>(problem, shape, options.formulation);
}

std::unique_ptr<Backend> make_implicit(const Options& options) {
    return make(KernelFamily(options, fetch_path(options.tuning.at("fetch"))), options, false);
}

// The tile is the cache, so it is filled past L1.
std::unique_ptr<Backend> make_tiled(const Options& options) {
    return make(KernelFamily(options, Fetch::past_l1), options, true);
}

}  // namespace voxspring::cuda
