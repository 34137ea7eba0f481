// The least work of a step, counted from the sources in kernels/: the part that all strategies have, and the
// two ways to find neighbours (by grid and by list) that OpenGL has too. What only one strategy does is
// counted beside its layout. Host code without a device.
#pragma once

#include <cstdint>

#include "backends/limits.h"
#include "backends/physics/formulation.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

template <class Real>
constexpr bool is_single = sizeof(Real) == sizeof(float);
/// The number of axes along which the neighbour in that direction lies.
inline std::uint64_t axes_of(const Direction& direction) {
    const glm::ivec3 o = direction.offset;
    return std::uint64_t((o.x != 0) + (o.y != 0) + (o.z != 0));
}

/// Operations of a vector times a scalar, whether or not it is added to a sum.
inline constexpr std::uint64_t vector_operations = 3;

/// The work of integrate_and_store(). Bytes: x(t) and x(t - dt) are read and x(t + dt) is written; in
/// formulations by increments x(t) and v are read and x(t + dt) and v are written; low parts take as much
/// again. Loads and inverse masses are read if the scene has them. All arrays are overwritten in place except
/// the one that neighbours read. Vector operations: the mass and the time step take 2; gravity, damping and
/// loads 1 each; next_position() and paper_position() 3 more, increments 2 and split sums 2 x 11.
template <class Real>
StepWork motion_work(const Problem& problem, Formulation formulation);

/// Floating-point operations of unit_pull() for all springs, each evaluated once.
template <class Real>
std::uint64_t pull_operations(const Problem& problem, Formulation formulation);

/// The work of a step that finds neighbours by grid offset. Words of inactive voxels do not count, and each
/// position counts as read once, although neighbours read it too.
template <class Real>
StepWork implicit_work(const Problem& problem, Formulation formulation);

/// The work of a step that finds neighbours by list, with or without the secondary list. Unused slots do not
/// count.
template <class Real>
StepWork explicit_work(const Problem& problem, bool secondary, Formulation formulation);

}  // namespace voxspring::layout
