// The parts of a step that every kernel shares: one spring's pull, and the integrator.
#pragma once

#include "backends/physics/inverse_root.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {

/// What moves every particle. A zero gravity or damping is a constant operand like any other; skipping it
/// would cost the branch that it saves.
template <class Real>
struct Motion {
    Vector<Real> gravity;
    Real inverse_mass;           ///< of all particles,
    const Real* inverse_masses;  ///< or one a word; null: all the same
    const Vector<Real>* load;    ///< constant force, one a word; null: none
    Real retained;               ///< 1 - damping
    Real time_step_squared;
    Real shortest_squared;
    bool operator==(const Motion&) const = default;
};

using voxspring::unit_force_density;

/// Force density of a spring of stiffness 1 along `offset`: the factor of `offset` in its force.
template <class Real>
VOXSPRING_HOST_DEVICE Real unit_force_density(Vector<Real> offset, Real rest_length, Real shortest_squared) {
    const Real squared = squared_length(offset.x, offset.y, offset.z, shortest_squared);
    return unit_force_density(squared, rest_length, inverse_root(squared));
}

/// The particle of word `index`, one step on under `force`; itself if it is pinned.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> moved(const Motion<Real>& motion, int index, Particle<Real> self,
                                           Vector<Real> previous, Vector<Real> force) {
    if ((self.bits & PINNED_BIT) != 0) return self;
    if (motion.load != nullptr) force = force + motion.load[index];
    const Real inverse_mass =
        motion.inverse_masses != nullptr ? motion.inverse_masses[index] : motion.inverse_mass;
    return {next_position(self.position, previous, force, inverse_mass, motion.gravity, motion.retained,
                          motion.time_step_squared),
            self.bits};
}

}  // namespace voxspring::cuda
