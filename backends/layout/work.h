// The least work of a step (bytes and operations), counted from the sources in kernels/: the part that most
// strategies have; the two ways to find neighbours, by grid and by list, that OpenGL backends have too; and
// springs evaluated by class (kernels/march.h), some of them only once for both ends. The work that only one
// strategy does is counted beside its layout. Host code without a device.
#pragma once

#include <array>
#include <cstdint>

#include "backends/limits.h"
#include "backends/physics/formulation.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

template <class Real>
constexpr bool is_single = sizeof(Real) == sizeof(float);
/// The number of axes along which a neighbour in `direction` is displaced: 1 to 3.
inline std::uint64_t axes_of(const Direction& direction) {
    const glm::ivec3 o = direction.offset;
    return std::uint64_t((o.x != 0) + (o.y != 0) + (o.z != 0));
}

/// The operations of a vector times a scalar; adding the product to a sum costs nothing more, as a fused
/// operation.
inline constexpr std::uint64_t vector_operations = 3;

/// The work of moving the particles (integrate_and_store()), given the spring forces.
/// Bytes: x(t) and x(t - dt) are read and x(t + dt) is written; in formulations by increments x(t) and v are
/// read and x(t + dt) and v are written; low parts take as much again. Loads and inverse masses are read if
/// the scene has them. All arrays of the state are overwritten in place except the one that neighbours read.
/// Vector operations: the mass and the time step take 2; gravity, damping and loads 1 each; next_position()
/// and paper_position() 3 more, increments 2 more, and sums with low parts 2 x 11 instead.
template <class Real>
StepWork motion_work(const Problem& problem, Formulation formulation);

/// The floating-point operations of unit_pull(), which computes a spring's force at stiffness 1, for all
/// springs, each evaluated once.
template <class Real>
std::uint64_t pull_operations(const Problem& problem, Formulation formulation);

/// The bytes that say how the springs beyond the lattice lie at rest: one SpringRest for each, but none in
/// formulations on positions.
template <class Real>
std::uint64_t off_lattice_rest_bytes(const Problem& problem, Formulation formulation);

/// The work of a step that finds neighbours by their offset in the grid. Words of inactive voxels do not
/// count. Each position counts as read once, although each neighbour reads it too.
template <class Real>
StepWork implicit_work(const Problem& problem, Formulation formulation);

/// The work of a step that finds neighbours by list. `secondary`: the list has a stiffness and a rest length
/// per spring. Unused slots do not count.
template <class Real>
StepWork explicit_work(const Problem& problem, bool secondary, Formulation formulation);

/// How often springs are evaluated: `springs` springs take `evaluations` evaluations, one for a spring
/// between particles of one thread, two for any other.
struct SharedSprings {
    std::uint64_t evaluations, springs;
};
/// The work of a step whose state is a structure of arrays. Masks do not count. `shares`: how often face
/// springs are evaluated, then edge springs.
template <class Real>
StepWork shared_springs_work(const Problem& problem, Formulation formulation,
                             const std::array<SharedSprings, 2>& shares);

/// The work of a step of cuda_march.
template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
