// The argument of the scatter kernels (cuda/kernels/scatter.h).
#pragma once

#include "backends/layout/records/motion.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {

/// Everything a step needs besides positions.
template <class Real>
struct ScatterStep {
    int particles;
    std::uint32_t group_bits;
    std::size_t springs;     ///< slots of all arrays; a stiffness of 0 marks an empty slot
    const SpringEnds* ends;  ///< on displacements `second` has a direction code, as seen from `first`
    const SpringConstants<Real>* constants;
    SpringRest<Real> rest[direction_codes];    ///< by direction code
    const SpringRest<Real>* off_lattice_rest;  ///< by slot, for OWN_DIRECTION; null: there are none
    /// x of all particles, then y, then z, `pitch` apart, so that neighbouring threads add to neighbouring
    /// addresses. It is zero between steps.
    Real* force;
    std::size_t pitch;
    Motion<Real> motion;
    bool operator==(const ScatterStep&) const = default;
};

}  // namespace voxspring::layout
