// Says whether a problem suits backends with implicit addressing, which find neighbours by their place in the
// lattice.
#pragma once

#include <string>

#include "backends/physics/problem.h"

namespace voxspring {

/// Empty, or why a backend that finds neighbours by their place in the lattice cannot run `problem`.
inline std::string implicit_refusal(const Problem& problem) {
    if (problem.lattice.voxel_count() == 0)
        return "implicit addressing needs a lattice, but the particles of this scene lie on none";
    if (!problem.springs.empty())
        return "some springs are not those of the lattice, which needs neighbour lists";
    return {};
}

}  // namespace voxspring
