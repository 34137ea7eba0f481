// Momentum and energy, which a simulation conserves or changes in a known way, and how far a run drifts from
// the reference in them.
#pragma once

#include <glm/vec3.hpp>

#include "backends/physics/problem.h"

namespace voxspring {

/// Momentum of the particles that can move.
struct Momentum {
    glm::dvec3 sum{0};  ///< m v, v = increment / time step: the velocity half a step ago
    double size = 0;    ///< sum of |m v|
    Momentum& operator+=(const Momentum& other);
};
Momentum momentum(const Problem& problem, const State& state);

/// Energy of the particles that can move and of all springs.
struct Energy {
    double kinetic = 0;     ///< sum of m |v|^2 / 2
    double springs = 0;     ///< sum of k (|d| - l)^2 / 2, free of cancellation
    double field = 0;       ///< -sum of (m g + load).u, zero at rest
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

/// The difference of a run from the reference after the same steps of the same problem. The discrete motion
/// does not conserve the continuous energy exactly; the difference shows only the effect of rounding.
struct Drift {
    double momentum = 0;  ///< |sum p - sum p_ref| / sum |p_ref|
    double energy = 0;    ///< (E - E_ref) / Energy::size() of the reference; positive: energy was gained
};
/// A component is 0 if numerator and denominator vanish, and infinite if only the denominator does.
Drift drift(const Conserved& run, const Conserved& reference);

}  // namespace voxspring
