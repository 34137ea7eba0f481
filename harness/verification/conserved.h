// Numbers that describe a whole state. Momentum and energy are conserved, or change in a known way.
// Statistics can still be compared after rounding has driven the particles of two runs apart.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Momentum of the particles that can move.
struct Momentum {
    glm::dvec3 sum{0};  ///< sum of m v; v is increment / time step, the velocity half a step ago
    double size = 0;    ///< sum of |m v|
    Momentum& operator+=(const Momentum& other);
};
Momentum momentum(const Problem& problem, const State& state);

/// Energy of the particles that can move and of the springs between particles; a tool's springs do not count.
/// Velocities are those of Momentum, so the problem must have a time step.
struct Energy {
    double kinetic = 0;     ///< sum of m |v|^2 / 2
    double springs = 0;     ///< sum of k (|d| - l)^2 / 2, free of cancellation
    double field = 0;       ///< by gravity and loads: -sum of (m g + load).u, u the displacement
    double field_size = 0;  ///< sum of |(m g + load).u|
    double total() const { return kinetic + springs + field; }
    double size() const { return kinetic + springs + field_size; }
    Energy& operator+=(const Energy& other);
};
Energy energy(const Problem& problem, const State& state);

/// Momentum and energy of one state.
struct Conserved {
    Momentum momentum;
    Energy energy;
};
Conserved conserved(const Problem& problem, const State& state);

/// The difference of a run from the reference after the same steps of the same problem. In discrete steps
/// energy is not conserved exactly; the difference from the reference shows only the effect of rounding.
struct Drift {
    double momentum = 0;  ///< |sum p - sum p_ref| / sum |p_ref|
    double energy = 0;    ///< (E - E_ref) / Energy::size() of the reference; positive: energy was gained
};
/// A member of the result is 0 if its numerator is 0, and otherwise infinite if its denominator is 0.
Drift drift(const Conserved& run, const Conserved& reference);

/// A number of a whole state by which two runs are compared.
struct Statistic {
    enum Kind : std::size_t { centre_of_mass, kinetic_energy, spring_energy, spectrum, count };
    double difference = 0;
    /// A magnitude of the reference (see statistics()). The tolerance of `difference` lies between two shares
    /// of it, unless it is infinite (statistic_gate()).
    double size = 0;
};
using Statistics = std::array<Statistic, Statistic::count>;
std::string to_string(Statistic::Kind kind);

/// The numbers of one state that statistics() compares with those of another.
struct StateSummary {
    double moved = 0;  ///< root mean square of the distances that particles moved
    glm::dvec3 centre_of_mass{0};
    Energy energy;
    /// Spectrum of the displacement in octaves. Element n is the root mean square difference of the
    /// displacements of particles 2^n voxels apart along an axis. Empty without a lattice.
    std::vector<double> spectrum;
};
/// Summarises `state`, which a run of the problem reached from `start`. The order of summation does not
/// depend on the number of threads.
StateSummary summary_of(const Problem& problem, const State& start, const State& state);
/// The function above, for a state whose energy() is already `known`.
StateSummary summary_of(const Problem& problem, const State& start, const State& state, const Energy& known);

/// Compares a run with the reference, both after the same steps from the same start:
///
/// | statistic | difference | size |
/// | --- | --- | --- |
/// | centre of mass | distance of the two centres | `moved` of the reference |
/// | kinetic, spring energy | difference of the two energies | Energy::size() of the reference |
/// | spectrum | Euclidean norm of the difference of the two | Euclidean norm of the reference's spectrum |
Statistics statistics(const StateSummary& run, const StateSummary& reference);

}  // namespace voxspring
