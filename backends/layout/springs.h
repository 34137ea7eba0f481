// How springs lie at rest, how list entries name neighbours, and which problems list layouts can hold.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backends/layout/records/springs.h"
#include "backends/physics/formulation.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// The square of a lattice direction's rest length. If the lattice is free of stress, this is the squared
/// length of the direction's offset, which a kernel computes at rest too. The square of the rounded length
/// could differ.
double squared_rest_length(const Problem& problem, const Direction& direction);

/// The rest length of a spring as the host gives it to the device. In formulations by increments it is the
/// length itself. Otherwise it is the squared length, from which the device measures the length. In the
/// formulation `displacement` a kernel computes the same square for a lattice spring at rest. So the force is
/// zero to the bit if the lattice is free of stress.
template <class Real>
Real listed_length(const Problem& problem, const Direction& direction, Formulation formulation);
template <class Real>
Real listed_length(const Spring& spring, Formulation formulation);

/// How the springs of each direction code lie at rest.
template <class Real>
std::array<SpringRest<Real>, direction_codes> rest_by_code(const Problem& problem);

/// How a spring beyond the lattice, from `particle` to `neighbour`, lies at rest.
template <class Real>
SpringRest<Real> off_lattice_rest_of(const Problem& problem, std::uint32_t particle, std::uint32_t neighbour,
                                     double rest_length);

/// The list entry for neighbour `index`. `bit`: the mask bit of its direction; -1 if the spring lies beyond
/// the lattice. In formulations on positions the entry is the index alone.
std::uint32_t entry_of(std::uint32_t index, int bit, Formulation formulation);

/// How many particles list entries with a direction code can number, from 0 on.
inline constexpr std::size_t max_listed_particles = std::size_t(LISTED_INDEX) + 1;
/// Empty, or why a list entry has no room for the index of each of `particles` particles beside a direction
/// code. Only formulations on displacements need both.
std::string list_entry_refusal(std::size_t particles, Formulation formulation);

/// Empty, or why lists cannot have one stiffness and one rest length for all springs of a group.
std::string grouped_list_refusal(const Problem& problem);

/// The number of springs of each particle.
std::vector<std::uint32_t> degrees(const Problem& problem);

/// The neighbour mask of a particle; 0 without a lattice.
inline std::uint32_t mask_of(const Problem& problem, std::size_t particle) {
    return problem.lattice.mask.empty() ? 0 : problem.lattice.mask[particle];
}

}  // namespace voxspring::layout
