// What is left to compare of two runs whose particles rounding has driven apart.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "backends/physics/problem.h"
#include "harness/verification/conserved.h"

namespace voxspring {

/// Numbers of a whole state by which two runs can be told apart.
struct Statistic {
    enum Kind : std::size_t { centre_of_mass, kinetic_energy, spring_energy, spectrum, count };
    double difference = 0;
    double size = 0;  ///< what the difference is a part of
};
using Statistics = std::array<Statistic, Statistic::count>;
std::string to_string(Statistic::Kind kind);

/// What statistics() compares of one state.
struct StateSummary {
    double moved = 0;  ///< root mean square of how far particles moved
    glm::dvec3 centre_of_mass{0};
    Energy energy;
    /// That of the displacement, in octaves: a band's number is the root mean square of the difference
    /// between particles 1, 2, 4 ... voxels apart along each axis. Empty without a lattice.
    std::vector<double> spectrum;
};
/// Of `state`, which the problem's particles reached from `start`. In an order of sums that does not depend
/// on the number of threads.
StateSummary summary_of(const Problem& problem, const State& start, const State& state);

/// Of a run against the reference, each after the same steps from the same start:
///
/// | statistic | difference | size |
/// | --- | --- | --- |
/// | centre of mass | of the two | `moved` of the reference |
/// | kinetic, spring energy | of the two | Energy::size() of the reference |
/// | spectrum | of the two, over all bands | of the reference, likewise |
Statistics statistics(const StateSummary& run, const StateSummary& reference);

}  // namespace voxspring
