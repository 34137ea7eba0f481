// Explicit addressing on the device: one thread a particle, with and without a secondary list.
#pragma once

#include <memory>
#include <numeric>
#include <utility>

#include "cuda/measure.h"
#include "cuda/particles.cuh"
#include "cuda/work.h"

namespace voxspring::cuda {

inline constexpr int most_explicit_threads = 512;
/// Blocks of that size an SM has to have room for. Named in the launch bounds, it lets the compiler spend the
/// registers on fetches in flight.
template <class Real>
inline constexpr int explicit_blocks_per_sm = sizeof(Real) == sizeof(float) ? 2 : 1;

template <bool face_and_edge, class Real, class Fetch>
__global__ void __launch_bounds__(most_explicit_threads, explicit_blocks_per_sm<Real>)
    step_explicit_by_groups(const __grid_constant__ ExplicitStep<Real> step,
                            const __grid_constant__ Fetch current, Word<Real>* previous) {
    step_by_groups<face_and_edge>(step, int(blockIdx.x * blockDim.x + threadIdx.x), current, previous);
}

template <class Real, class Fetch>
__global__ void __launch_bounds__(most_explicit_threads, explicit_blocks_per_sm<Real>)
    step_explicit_by_springs(const __grid_constant__ ExplicitStep<Real> step,
                             const __grid_constant__ Fetch current, Word<Real>* previous) {
    step_by_springs(step, int(blockIdx.x * blockDim.x + threadIdx.x), current, previous);
}

/// When a backend carries the secondary list.
enum class Secondary : std::uint8_t { always, where_needed, never };

struct ExplicitOptions {
    Secondary secondary = Secondary::always;
    ListLayout layout = ListLayout::vertical;
    unsigned block = 128;  ///< threads

    ExplicitOptions(Secondary when, const Options& options)
        : secondary(when),
          layout(options.tuning.at("layout") == "vertical" ? ListLayout::vertical : ListLayout::concatenated),
          block(unsigned(std::stoul(options.tuning.at("block")))) {}

    bool has_secondary(const Problem& problem) const {
        return secondary == Secondary::always ||
               (secondary == Secondary::where_needed && !beyond_groups(problem).empty());
    }
};

/// Bytes of device memory.
template <class Real>
std::uint64_t explicit_bytes(const Problem& problem, const ExplicitOptions& options) {
    const bool secondary = options.has_secondary(problem);
    const std::uint32_t slots = secondary ? slots_by_springs(problem) : slots_by_groups(problem);
    return particle_bytes<Real>(problem, problem.particle_count()) +
           list_size(problem.particle_count(), slots, options.layout) *
               (sizeof(std::uint32_t) + (secondary ? sizeof(SpringConstants<Real>) : 0));
}

/// `when`: whether there is a secondary list.
template <class Real, class Fetch, Secondary when>
class ExplicitBackend final : public ParticleBackend<Real, Fetch, ExplicitStep<Real>> {
public:
    explicit ExplicitBackend(const ExplicitOptions& options) : options_(options) {}

    void upload(const Problem& problem, const State& state) override {
        this->synchronize();
        const auto [launch, bits] = lay_out(problem);
        this->start(problem, state, place_compact(problem), bits, launch);
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        this->follow(edited);
        if (edit.empty()) return;
        const ExplicitStep<Real>& step = this->launch().step;
        const bool secondary = options_.has_secondary(edited);
        if (secondary != (step.constants != nullptr) || longest_list(edit) > step.shape.slots) {
            lay_out_anew(edited);
            return;
        }
        const EditedLists<Real> rows = secondary ? edited_by_springs<Real>(edited, edit, step.shape.slots)
                                                 : edited_by_groups<Real>(edited, edit, step.shape.slots);
        write_rows(edited_rows_.send(rows, this->stream()), rows.particle.size(), step.shape,
                   this->current_words(), neighbour_.data(), constants_.data(), this->stream());
    }

    StepWork step_work(const Problem& problem) const override {
        return explicit_work<Real>(problem, options_.has_secondary(problem));
    }

private:
    struct LaidOut {
        typename ExplicitBackend::Launch launch;
        std::vector<std::uint32_t> bits;
    };

    /// Makes and uploads the lists.
    LaidOut lay_out(const Problem& problem) {
        const bool secondary = options_.has_secondary(problem);
        NeighbourLists<Real> lists = secondary ? list_by_springs<Real>(problem, options_.layout)
                                               : list_by_groups<Real>(problem, options_.layout);
        neighbour_.upload(lists.neighbour, this->stream());
        constants_.upload(lists.constants, this->stream());
        measure_rest_lengths(constants_, this->stream());

        typename ExplicitBackend::Launch launch;
        launch.block = dim3(options_.block);
        launch.grid = dim3(blocks_for(problem.particle_count(), options_.block));
        launch.kernel = choose_kernel(problem, secondary);
        launch.step = make_explicit_step<Real>(problem, lists);
        launch.step.neighbour = neighbour_.data();
        launch.step.constants = constants_.data();
        measure_rest_lengths<Real>(launch.step.rest_length, this->stream());
        return {launch, std::move(lists.bits)};
    }

    /// Longer lists, or lists of the other kind, for the particles where they are.
    void lay_out_anew(const Problem& edited) {
        this->synchronize();
        auto [launch, bits] = lay_out(edited);
        launch.step.motion = this->launch().step.motion;
        this->replay(launch);
        std::vector<std::uint32_t> all(edited.particle_count());
        std::iota(all.begin(), all.end(), 0U);
        this->write_particle_bits(all, bits);
    }

    // Compiles only what `when` can come to.
    static auto choose_kernel(const Problem& problem, [[maybe_unused]] bool secondary) {
        typename ExplicitBackend::Kernel kernel = nullptr;
        if constexpr (when != Secondary::never) kernel = step_explicit_by_springs<Real, Fetch>;
        if constexpr (when != Secondary::always) {
            const bool face_and_edge = problem.group_bits == (FACE_BITS | EDGE_BITS);
            if (!secondary)
                kernel = face_and_edge ? step_explicit_by_groups<true, Real, Fetch>
                                       : step_explicit_by_groups<false, Real, Fetch>;
        }
        return kernel;
    }

    std::string refused(const Problem& problem) const override {
        if constexpr (when == Secondary::never) {
            if (const std::string why = beyond_groups(problem); !why.empty())
                return "a counter a spring group holds no constants of single springs: " + why;
        }
        return too_many_words<Fetch>(problem.particle_count(), this->device());
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return explicit_bytes<Real>(problem, options_);
    }
    std::uint64_t bytes_held() const override {
        return this->particle_bytes_held() + neighbour_.bytes() + constants_.bytes() + edited_rows_.bytes();
    }

    ExplicitOptions options_;
    Buffer<std::uint32_t> neighbour_;
    Buffer<SpringConstants<Real>> constants_;
    StagedRows<Real> edited_rows_;
};

template <Secondary secondary>
std::uint64_t explicit_bytes(const Problem& problem, const Options& options) {
    const ExplicitOptions chosen(secondary, options);
    return options.precision == Precision::float32 ? explicit_bytes<float>(problem, chosen)
                                                   : explicit_bytes<double>(problem, chosen);
}

/// The backend that fetches neighbours through `Fetch`.
template <Secondary secondary, template <class> class Fetch>
std::unique_ptr<Backend> make_explicit(const Options& options) {
    const ExplicitOptions chosen(secondary, options);
    if (options.precision == Precision::float32)
        return std::make_unique<ExplicitBackend<float, Fetch<float>, secondary>>(chosen);
    return std::make_unique<ExplicitBackend<double, Fetch<double>, secondary>>(chosen);
}

/// Threads of a block, the default first.
inline const TuningValues explicit_blocks = {"128", "64", "256", "512"};
/// The paper's Figure 6 b and a.
inline const TuningValues list_layouts = {"vertical", "concatenated"};

}  // namespace voxspring::cuda
