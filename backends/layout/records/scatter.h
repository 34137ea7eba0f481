// The argument of the scatter kernels (cuda/kernels/scatter.h). In the first a thread adds the force of one
// spring to both of its particles; the second moves the particles.
#pragma once

#include "backends/layout/records/motion.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {

/// Everything a step needs besides the particles' state.
template <class Real>
struct ScatterStep {
    int particles;
    std::uint32_t group_bits;
    /// The number of slots in each array. A slot whose stiffness is 0 is empty.
    std::size_t springs;
    /// The ends of each spring. In formulations on displacements `second` also has a direction code, seen
    /// from `first` (neighbours.h).
    const SpringEnds* ends;
    const SpringConstants<Real>* constants;
    SpringRest<Real> rest[direction_codes];  ///< how springs lie at rest, by direction code
    /// How springs with direction code OWN_DIRECTION lie at rest, by slot; null: there are none.
    const SpringRest<Real>* off_lattice_rest;
    /// The sum of the spring forces on each particle: x of all particles, then y, then z, `pitch` elements
    /// apart, so that neighbouring threads add to neighbouring addresses. The sums are zero between steps.
    Real* force;
    std::size_t pitch;
    Motion<Real> motion;
    bool operator==(const ScatterStep&) const = default;
};

}  // namespace voxspring::layout
