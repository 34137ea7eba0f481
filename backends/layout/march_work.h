// The least work of a step of kernels that evaluate springs by class (kernels/march.h), some of them once for
// both ends.
#pragma once

#include <array>
#include <cstdint>

#include "backends/limits.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// How many evaluations the springs of some particles take. Springs between particles of one thread take one,
/// others two.
struct SharedSprings {
    std::uint64_t evaluations, springs;
};
/// The work of a step on particles in structure of arrays without masks. `shares`: of face and edge springs.
template <class Real>
StepWork shared_springs_work(const Problem& problem, Formulation formulation,
                             const std::array<SharedSprings, 2>& shares);

/// The work of a step of cuda_march.
template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
