// What moves particles besides springs, and where a step writes them.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// What moves every particle.
template <class Real>
struct Motion {
    Vector<Real> gravity;
    Real inverse_mass;           ///< of all particles,
    const Real* inverse_masses;  ///< or one per word; null: all the same
    const Vector<Real>* load;    ///< constant force, one per word; null: none
    Real damping;                ///< lambda
    Real retained;               ///< 1 - lambda
    Real doubled;                ///< 2 - lambda
    Real time_step_squared;
    Real shortest_squared;
    bool operator==(const Motion&) const = default;
};

/// What a step writes.
template <class Real>
struct Output {
    ParticleRecord<Real>* next;      ///< at t + dt; before, t - dt for `position` and `displacement`
    ParticleRecord<Real>* next_low;  ///< their low parts (`compensated`)
    /// v, by increments: x of all words, then y, then z, `pitch` apart. A step overwrites it in place.
    Real* increment;
    Real* increment_low;
    std::size_t pitch;
};

}  // namespace voxspring::layout
