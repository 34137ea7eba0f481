// What moves particles besides springs, and the arrays that a step writes.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// What moves particles besides springs, with their masses.
template <class Real>
struct Motion {
    Vector<Real> gravity;
    Real inverse_mass;           ///< 1 / mass of every particle, if inverse_masses is null
    const Real* inverse_masses;  ///< 1 / mass, one per word; null: all particles have one mass
    const Vector<Real>* load;    ///< force, one per word; a tool may change it; null: none
    Real damping;                ///< lambda
    Real retained;               ///< 1 - lambda
    Real doubled;                ///< 2 - lambda
    Real time_step_squared;
    Real shortest_squared;
    Real flushed_below;  ///< a length: the constant of this name times the shortest spacing
    bool operator==(const Motion&) const = default;
};

/// What a step writes.
template <class Real>
struct Output {
    /// The array that gets x or u at t + dt. In formulations without increments a step also reads what is in
    /// it before: x or u at t - dt.
    ParticleRecord<Real>* next;
    ParticleRecord<Real>* next_low;  ///< low parts of `next`, in `compensated`
    /// The increments v, in formulations by increments: x of all words, then y, then z, `pitch` elements
    /// apart. A step overwrites them.
    Real* increment;
    Real* increment_low;
    std::size_t pitch;
};

}  // namespace voxspring::layout
