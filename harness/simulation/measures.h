// Properties of a state that a window shows.
#pragma once

#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Whether every number of the state is finite.
bool finite(const State& state);

/// For each particle the mean of |x_i - x_j| / l_ij - 1 over its springs: how much they are stretched, as a
/// share of the rest length; negative if they are shortened. 0 for a particle without springs. Springs of
/// rest length 0 are left out. Runs on all cores.
std::vector<double> tensions(const Problem& problem, const State& state);

}  // namespace voxspring
