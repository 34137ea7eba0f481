// What moves particles besides springs, and where a step writes them.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// What moves every particle besides springs.
template <class Real>
struct Motion {
    Vector<Real> gravity;
    Real inverse_mass;           ///< the same for all particles; used if inverse_masses is null
    const Real* inverse_masses;  ///< one per word
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
    /// x or u at t + dt. Before the step it holds x or u at t - dt (`position` and `displacement`).
    ParticleRecord<Real>* next;
    ParticleRecord<Real>* next_low;  ///< low parts of `next` (`compensated`)
    /// v, by increments: x of all words, then y, then z, `pitch` apart. A step overwrites it in place.
    Real* increment;
    Real* increment_low;
    std::size_t pitch;
};

}  // namespace voxspring::layout
