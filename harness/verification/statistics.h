// What is left to compare of two runs whose particles rounding has driven apart.
#pragma once

#include <array>
#include <string>

#include "backends/physics/problem.h"

namespace voxspring {

/// Numbers of a whole state by which two runs can be told apart.
struct Statistic {
    enum Kind : std::size_t { centre_of_mass, kinetic_energy, spring_energy, spectrum, count };
    double difference = 0;
    double size = 0;  ///< what the difference is a part of
};
using Statistics = std::array<Statistic, Statistic::count>;
std::string to_string(Statistic::Kind kind);

/// Of `state` against `reference`, each after the same steps from `start`:
///
/// | statistic | difference | size |
/// | --- | --- | --- |
/// | centre of mass | of the two | the root mean square of how far particles moved |
/// | kinetic, spring energy | of the two | Energy::size() of the reference |
/// | spectrum | of the two, over all bands | of the reference, likewise |
///
/// The spectrum is that of the displacement, in octaves: a band's number is the root mean square of the
/// difference between particles 1, 2, 4 ... voxels apart along each axis; without a lattice it is left out.
Statistics statistics(const Problem& problem, const State& start, const State& state, const State& reference);

}  // namespace voxspring
