// Statistics that can still be compared after rounding has driven the particles of two runs apart.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "backends/physics/problem.h"
#include "harness/verification/conserved.h"

namespace voxspring {

/// A number of a whole state by which two runs are compared.
struct Statistic {
    enum Kind : std::size_t { centre_of_mass, kinetic_energy, spring_energy, spectrum, count };
    double difference = 0;
    double size = 0;  ///< the size with which the difference is compared
};
using Statistics = std::array<Statistic, Statistic::count>;
std::string to_string(Statistic::Kind kind);

/// The quantities of one state that statistics() compares.
struct StateSummary {
    double moved = 0;  ///< root mean square of the distances that particles moved
    glm::dvec3 centre_of_mass{0};
    Energy energy;
    /// Spectrum of the displacement in octaves. The number of a band is the root mean square of the
    /// difference between particles 1, 2, 4 ... voxels apart along each axis. Empty without a lattice.
    std::vector<double> spectrum;
};
/// Summarises `state`, which the problem's particles reached from `start`. The order of summation does not
/// depend on the number of threads.
StateSummary summary_of(const Problem& problem, const State& start, const State& state);

/// Compares a run with the reference, both after the same steps from the same start:
///
/// | statistic | difference | size |
/// | --- | --- | --- |
/// | centre of mass | distance of the two | `moved` of the reference |
/// | kinetic, spring energy | difference of the two | Energy::size() of the reference |
/// | spectrum | Euclidean norm of the differences of bands | that norm of the reference's bands |
Statistics statistics(const StateSummary& run, const StateSummary& reference);

}  // namespace voxspring
