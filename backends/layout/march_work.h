// The least work of a step of kernels that evaluate springs by class (kernels/march.h). They evaluate some
// springs only once for both ends.
#pragma once

#include <array>
#include <cstdint>

#include "backends/limits.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// `springs` springs take `evaluations` evaluations: one for a spring within a thread, two for any other.
struct SharedSprings {
    std::uint64_t evaluations, springs;
};
/// The work of a step whose state is a structure of arrays. Masks do not count. `shares`: evaluations of face
/// springs, then of edge springs.
template <class Real>
StepWork shared_springs_work(const Problem& problem, Formulation formulation,
                             const std::array<SharedSprings, 2>& shares);

/// The work of a step of cuda_march.
template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
