// The least that a step of each strategy takes, counted from the sources in kernels/. Host code without a
// device, like layout.h.
#pragma once

#include "backends/limits.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::cuda {

/// Floating-point operations of unit_pull() on every spring, each evaluated once.
template <class Real>
std::uint64_t pull_operations(const Problem& problem, Formulation formulation);

/// Of particles by grid offset. Words of inactive voxels do not count, nor neighbours a second time.
template <class Real>
StepWork implicit_work(const Problem& problem, Formulation formulation);

/// The same in structure of arrays without masks, most springs evaluated once for both of their ends.
template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation);

/// Of particles by list, with or without the secondary list. Unused slots do not count.
template <class Real>
StepWork explicit_work(const Problem& problem, bool secondary, Formulation formulation);

/// Of particles by delta-compressed list. The lists of runs, which are few, do not count.
template <class Real>
StepWork delta_work(const Problem& problem, Formulation formulation);

/// Of springs, then particles.
template <class Real>
StepWork scatter_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::cuda
