// A step of the perturbed reference, compiled for every SIMD target.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::perturbed {

/// Numbers per block: as many as a register of the widest SIMD target holds.
constexpr std::ptrdiff_t block_size = 8;

/// One direction of the stencil: the springs from particles to their neighbours in that direction.
struct Pull {
    std::ptrdiff_t stride;  ///< elements to the neighbour
    std::uint64_t bit;
    std::array<double, 3> rest_offset;  ///< rest position minus that of the neighbour
    double rest_length, rest_deficit, stiffness;
};

/// How numbers are rounded: random bits and a constant are added, then bits that are not kept are cleared.
struct RoundingBits {
    std::uint64_t kept = ~std::uint64_t(0);  ///< mask of the bits that are kept
    std::uint64_t random = 0;                ///< mask of the random bits that are added
    std::uint64_t also_random = 0;           ///< a second such mask, for the upper half of the random number
    std::uint64_t constant = 0;              ///< added to every number
    double unit = 0;                         ///< relative size of the errors of forces; 0: no errors
    double root_error = 0;
    std::uint64_t key = 0;  ///< random numbers depend on the key, which differs from step to step

    bool any() const { return kept != ~std::uint64_t(0) || random != 0 || unit != 0 || root_error != 0; }
};

/// A step of the blocks [begin, end), each given by its first element. Arrays are over the padded grid.
struct Task {
    std::array<const double*, 3> at;          ///< positions x or displacements u
    std::array<double*, 3> next;              ///< holds the previous x or u until it is overwritten
    std::array<double*, 3> increment;         ///< null unless the formulation has it
    std::array<const double*, 3> load;        ///< constant forces; null: none
    std::array<const double*, 3> extra;       ///< forces of Problem::springs; null: none
    std::array<const double*, 3> extra_size;  ///< the rounding error of `extra` is in proportion to this
    const std::uint64_t* mask;
    const double* inverse_mass;
    const double* compliance;  ///< null: one stiffness per direction
    const std::ptrdiff_t *begin, *end;
    const Pull* pulls;
    std::size_t pull_count;
    double shortest_squared;
    std::array<double, 3> gravity;
    double damping, retained, doubled, time_step_squared;
    RoundingBits rounding;
};

void step(const Task& task, Formulation formulation);

/// `value`, rounded with the random bits that the kernel uses for `element` and `which`.
double rounded(double value, const RoundingBits& bits, std::uint64_t element, std::uint64_t which);
/// The random number in [-1, 1) that the kernel takes for an element and a use of it, `which`, in the step
/// that `bits` belong to.
double random_number(const RoundingBits& bits, std::uint64_t element, std::uint64_t which);

}  // namespace voxspring::perturbed
