// The least work of a step of cuda_march, counted from kernels/march.h.
#pragma once

#include "backends/limits.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// The work of a step on particles in structure of arrays without masks, with most springs evaluated once for
/// both ends.
template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
