// The memory layout of cpu_parallel. The lattice becomes a padded grid. State, loads and materials are arrays
// over this grid.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>

#include "backends/backend.h"
#include "backends/cpu/array.h"
#include "backends/cpu/kernel.h"
#include "backends/cpu/parallel_options.h"
#include "backends/physics/stored.h"

namespace voxspring::cpu_parallel {

/// The lattice in memory. Each row is padded to whole blocks of block_size elements. Before the lattice and
/// after it lies a guard, at least as long as the distance of the farthest neighbour. So a SIMD register can
/// be loaded with the neighbours of any block.
template <class T>
struct PaddedGrid {
    glm::ivec3 dims;
    std::ptrdiff_t row, slice, guard;

    explicit PaddedGrid(glm::ivec3 d)
        : dims(d),
          row((d.x + block_size<T> - 1) / block_size<T> * block_size<T>),
          slice(row * d.y),
          guard(slice + row + block_size<T>) {}

    std::ptrdiff_t size() const { return guard + slice * dims.z + guard; }
    std::ptrdiff_t element(glm::ivec3 c) const { return guard + slice * c.z + row * c.y + c.x; }
    /// Blocks per row, rows per slice, and slices.
    glm::ivec3 blocks() const { return {int(row / block_size<T>), dims.y, dims.z}; }
    std::ptrdiff_t density_guard() const { return row + block_size<T>; }
    /// Elements for the force densities of one direction in one slice: a guard, the slice, and a guard.
    std::ptrdiff_t densities() const { return density_guard() + slice + density_guard(); }
};

/// The state, loads and materials. An array is null if the formulation or the problem does not need it.
/// Elements without a particle are NaN (masks: 0), so that a force that uses one by mistake becomes NaN.
template <class T>
struct PaddedState {
    using Vector = std::array<Array<T>, 3>;

    PaddedGrid<T> grid{glm::ivec3(0)};
    Array<MaskOf<T>> mask;
    /// Positions or displacements after even steps and after odd steps: a step reads one of the two and
    /// overwrites the other.
    std::array<Vector, 2> at, at_low;
    Vector increment, increment_low, load;
    Array<T> inverse_mass, compliance;

    PaddedState() = default;
    /// `state` counts as the state after an even step.
    PaddedState(const Problem& problem, const Options& options, const State& state);

    /// The state after an even (`current` 0) or an odd step (`current` 1), in canonical order.
    State unpack(const Problem& problem, Formulation formulation, std::size_t current) const;

    std::ptrdiff_t element_of(const Problem& problem, std::size_t particle) const {
        return grid.element(problem.lattice.coordinates(problem.lattice.voxel[particle]));
    }

private:
    void allocate(const Problem& problem, const Options& options);
    void pack(const Problem& problem, Formulation formulation, const State& state, std::size_t particle);
};

template <class T>
PaddedState<T>::PaddedState(const Problem& problem, const Options& options, const State& state)
    : grid(problem.lattice.dims) {
    allocate(problem, options);
    const auto particles = std::ptrdiff_t(problem.particle_count());
#pragma omp parallel for schedule(static) if (particles >= worth_threads)
    for (std::ptrdiff_t i = 0; i < particles; ++i) pack(problem, options.formulation, state, std::size_t(i));
}

template <class T>
void PaddedState<T>::allocate(const Problem& problem, const Options& options) {
    const auto array = [&](bool needed) -> Array<T> {
        if (!needed) return nullptr;
        return filled(grid.size(), std::numeric_limits<T>::quiet_NaN());
    };
    const bool all = all_terms(options);
    const bool split = options.formulation == Formulation::compensated;
    mask = filled<MaskOf<T>>(grid.size(), 0);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (std::size_t parity = 0; parity < 2; ++parity) {
            at[parity][axis] = array(true);
            at_low[parity][axis] = array(split);
        }
        increment[axis] = array(by_increments(options.formulation));
        increment_low[axis] = array(split);
        load[axis] = array(all || !problem.load.empty());
    }
    inverse_mass = array(all || problem.has_materials());
    compliance = array(problem.has_materials());
}

template <class T>
void PaddedState<T>::pack(const Problem& problem, Formulation formulation, const State& state,
                          std::size_t particle) {
    const auto element = std::size_t(element_of(problem, particle));
    const auto put = [element](Array<T>& to, double value) {
        if (to != nullptr) to[element] = T(value);
    };
    const glm::dvec3 displacement = state.displacement_of(particle), moved = state.increment_of(particle);
    const glm::dvec3 here =
        on_positions(formulation) ? problem.rest_position[particle] + displacement : displacement;
    const glm::dvec3 before = here - moved;
    mask[element] = problem.lattice.mask[particle];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const int a = int(axis);
        const double step = moved[a];
        put(at[0][axis], here[a]);
        put(at_low[0][axis], lost_by<T>(here[a]));
        put(at[1][axis], before[a]);
        put(increment[axis], step);
        put(increment_low[axis], lost_by<T>(step));
        put(load[axis], problem.load.empty() ? 0 : problem.load[particle][a]);
    }
    const Material& material = problem.material_of(particle);
    put(inverse_mass, 1 / material.mass);
    put(compliance, 1 / material.stiffness);
}

template <class T>
State PaddedState<T>::unpack(const Problem& problem, Formulation formulation, std::size_t current) const {
    State state = state_at_rest(problem);
    const auto particles = std::ptrdiff_t(problem.particle_count());
#pragma omp parallel for schedule(static) if (particles >= worth_threads)
    for (std::ptrdiff_t particle = 0; particle < particles; ++particle) {
        const auto i = std::size_t(particle);
        const auto element = std::size_t(element_of(problem, i));
        const auto part = [element](const Array<T>& array) {
            return array == nullptr ? 0.0 : double(array[element]);
        };
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const int a = int(axis);
            const double here = part(at[current][axis]);
            const double rest = on_positions(formulation) ? problem.rest_position[i][a] : 0;
            state.displacement[i][a] = here - rest + part(at_low[current][axis]);
            state.increment[i][a] = by_increments(formulation)
                                        ? part(increment[axis]) + part(increment_low[axis])
                                        : here - part(at[1 - current][axis]);
        }
    }
    return state;
}

}  // namespace voxspring::cpu_parallel
