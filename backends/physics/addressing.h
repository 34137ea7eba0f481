// Which problems a backend can address by their places in the lattice.
#pragma once

#include <string>

#include "backends/physics/problem.h"

namespace voxspring {

/// Empty, or why a backend cannot run `problem` that finds a neighbour by its place in the grid.
inline std::string implicit_refusal(const Problem& problem) {
    if (problem.lattice.voxel_count() == 0)
        return "addressing by the lattice needs a lattice, and the particles lie on none";
    if (!problem.springs.empty()) return "addressing by the lattice has no springs beyond the lattice";
    return {};
}

}  // namespace voxspring
