// The base class of backends whose state is a structure of arrays (backends/layout/march_layout.h), and what
// all kernels that evaluate springs by class (spring_class()) have in common.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "backends/by_precision.h"
#include "backends/layout/march_cost.h"
#include "backends/layout/march_layout.h"
#include "backends/layout/particles.h"
#include "backends/physics/addressing.h"
#include "backends/physics/huge_pages.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/border.h"
#include "cuda/common/cuda_backend.h"
#include "cuda/common/device_borders.h"

namespace voxspring::cuda {

/// The numbers of `device` from which plan_march() and plan_bricks() predict times.
inline MarchDevice march_device(const Device& device) {
    return {.multiprocessors = device.multiprocessors,
            .threads = device.threads_per_multiprocessor,
            .shared_bytes = device.multiprocessor_shared_bytes,
            .reserved_bytes = device.reserved_shared_bytes,
            .block_shared_bytes = device.shared_bytes,
            .hertz = 1e6 * device.sm_mhz,
            .bytes_per_second = device.memory_bytes_per_second,
            .cache_bytes = double(device.cache_bytes)};
}

/// Empty, or why a kernel that evaluates springs by class (spring_class()) cannot step `problem`. `strategy`:
/// what the message calls the kernel, for example "the march".
inline std::string class_refusal(const Problem& problem, Precision precision, Formulation formulation,
                                 const std::string& strategy) {
    if (std::string why = implicit_refusal(problem); !why.empty()) return why;
    if ((problem.group_bits & CORNER_BITS) != 0) return strategy + " cannot step corner springs";
    if (!has_inverse_lengths(problem, precision, formulation))
        return strategy + " cannot step springs whose rest length is zero or nearly zero";
    if (!has_class_lengths(problem))
        return strategy + " cannot step the two diagonals of a plane with different rest lengths";
    if (problem.has_materials()) return strategy + " can step one material only";
    if (!problem.load.empty()) return strategy + " cannot apply loads";
    return {};
}

/// Empty, or why a border cannot have indices into arrays whose largest index is below `elements`.
inline std::string border_index_refusal(std::size_t elements) {
    constexpr std::size_t most = std::numeric_limits<std::uint32_t>::max();
    if (elements <= most) return {};
    return "the arrays of this part have " + std::to_string(elements) +
           " elements that a border indexes, but it can index at most " + std::to_string(most);
}

/// The macros REAL, FETCH, TERMS and EQUAL_EDGES for a kernel that has code per spring_class().
inline std::map<std::string, std::string> class_macros(const Problem& problem, Formulation formulation,
                                                       Precision precision) {
    // These kernels have no term for pins: their masks say which particles move.
    const std::uint32_t terms = terms_of(problem) & (term_damping | term_gravity);
    return {{"REAL", precision == Precision::float32 ? "float" : "double"},
            {"FETCH", "PastL1"},  // entry.h needs it; these kernels do not use it
            {"TERMS", "KernelTerms<Formulation::" + to_string(formulation) + "," +
                          std::to_string(problem.group_bits) + "u," + std::to_string(terms) + "u,false>"},
            {"EQUAL_EDGES", equal_edges(problem, formulation) ? "true" : "false"}};
}

template <class Real>
class AxesBackend : public CudaBackend {
public:
    explicit AxesBackend(Formulation formulation) : formulation_(formulation) {}

    /// Bytes of device memory that the state takes, unless places() is overridden.
    static std::uint64_t state_bytes(const Lattice& lattice, Formulation formulation) {
        return (by_increments(formulation) ? 3 : 2) * march_strides(lattice, sizeof(Real)).size() *
               sizeof(Real);
    }

    State download() final {
        synchronize();
        SoaState<Real> packed;
        const auto out = [&](std::vector<Real>& values, const Buffer<Real>& buffer) {
            resize_in_huge_pages(values, buffer.size());
            buffer.download(values, stream());
        };
        const auto now = std::size_t(current());
        out(packed.current, positions_[now]);
        out(packed.before, by_increments(formulation_) ? increment_ : positions_[1 - now]);
        return unpack_soa<Real>(problem(), packed, formulation_, places());
    }
    std::string state_fingerprint() final {
        synchronize();
        StateHash hash(stream());
        const auto now = std::size_t(current());
        hash.add(positions_[now]);
        hash.add(by_increments(formulation_) ? increment_ : positions_[1 - now]);
        return hash.text();
    }

    BorderFacet* borders() override { return gives_borders() ? this : nullptr; }
    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        return make_border(elements_of(particles, places().element), border_state());
    }
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& borders,
                                                  const std::string& way) override {
        return make_device_borders(in_elements(borders, places().element), way, device(),
                                   border_state(enable_border_stream(borders, way)));
    }

protected:
    static constexpr Precision precision =
        sizeof(Real) == sizeof(float) ? Precision::float32 : Precision::float64;

    Formulation formulation() const { return formulation_; }
    /// The elements of the state's arrays that hold the particles of problem().
    virtual SoaPlaces places() const { return march_places(problem().lattice, sizeof(Real)); }
    /// One of the two buffers (0 or 1) of positions x or displacements u. Steps that are launched separately
    /// write the two in turn.
    Real* positions(std::size_t buffer) const { return positions_[buffer].data(); }
    Real* increment() const { return increment_.data(); }
    std::uint64_t state_bytes_held() const {
        return positions_[0].bytes() + positions_[1].bytes() + increment_.bytes();
    }

    /// Uploads `state` into the elements that places() tells. To be called after set_problem(problem).
    void upload_state(const Problem& problem, const State& state) {
        const SoaPlaces places = this->places();
        axis_ = places.axis;
        const SoaState<Real> packed = pack_soa<Real>(problem, state, formulation_, places);
        positions_[0].upload(packed.current, stream());
        if (by_increments(formulation_)) {
            // No step reads a particle's u from this buffer before it has been written there. Elements
            // without a particle stay zero.
            positions_[1].resize(packed.current.size());
            positions_[1].fill_with_zeros(stream());
            increment_.upload(packed.before, stream());
        } else {
            positions_[1].upload(packed.before, stream());
            increment_.resize(0);
        }
    }
    /// The kernel's constants for `problem`. In formulations that are not by increments, the device computes
    /// the inverse rest lengths, with its own inverse root.
    MarchStep<Real> measured_step(const Problem& problem) const {
        MarchStep<Real> step = make_march_step<Real>(problem, formulation_);
        if (!by_increments(formulation_))
            measure_on_device<Real>(*support_kernels<Real>().measure_inverse_roots, step.rest_length,
                                    stream());
        return step;
    }

    std::vector<StateArray> state_arrays() const final {
        return {state_array(positions_[0]), state_array(positions_[1]), state_array(increment_)};
    }
    void enqueue_divergence_check(const DivergenceCheck& parameters, FirstDivergence* first) final {
        const auto now = std::size_t(current());
        const Real* const before = by_increments(formulation_) ? nullptr : positions_[1 - now].data();
        launch_divergence_check(
            *support_kernels<Real>().check_axes,
            ParticlesInAxes<Real>{positions_[now].data(), before, increment_.data(), axis_},
            positions_[now].size() / 3, parameters, first, stream());
    }

private:
    BorderState<Real> border_state(BordersFirst* first = nullptr) {
        return {.stream = stream(),
                .now =
                    [this] {
                        return BorderPlaces<Real>{.element = nullptr,
                                                  .count = 0,
                                                  .at = positions_[std::size_t(current())].data(),
                                                  .low = nullptr,
                                                  .element_pitch = 1,
                                                  .axis_pitch = axis_};
                    },
                .written = [] {},
                .wait = border_wait(),
                .first = first};
    }

    const Formulation formulation_;
    std::size_t axis_ = 0;  ///< SoaPlaces::axis
    std::array<Buffer<Real>, 2> positions_;
    Buffer<Real> increment_;
};

}  // namespace voxspring::cuda
