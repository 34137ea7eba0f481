// What a window says of a state.
#pragma once

#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Whether every number of the state is.
bool finite(const State& state);

/// For each particle the mean of |x_i - x_j| / l_ij - 1 over its springs: by how much they are stretched, or
/// shorter where it is negative, as a part of their rest lengths. 0 without springs; those of no rest length
/// are left out. On all cores.
std::vector<double> tensions(const Problem& problem, const State& state);

}  // namespace voxspring
