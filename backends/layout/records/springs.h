// A spring in memory: the constants of its force, and the particles that it joins.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// The constants of one spring of a list.
template <class Real>
struct alignas(2 * sizeof(Real)) SpringConstants {
    Real stiffness;
    /// The rest length as unit_pull() takes it. If the device has to measure it with measured_length(), the
    /// square of the rest length is stored here until then (calibrate_rest_lengths).
    Real rest_length;
};

/// How the ends i and j of a spring lie at rest: RestSpring (problem.h), but with the offset from i to j.
template <class Real>
struct alignas(4 * sizeof(Real)) SpringRest {
    Vector<Real> offset;  ///< X_j - X_i
    Real deficit;         ///< l^2 - |offset|^2
    bool operator==(const SpringRest&) const = default;
};

/// Direction codes of list entries (LISTED_INDEX_BITS of neighbours.h) are less than this.
inline constexpr int direction_codes = 32;

/// The two particles of a spring.
struct alignas(8) SpringEnds {
    std::uint32_t first, second;
    bool operator==(const SpringEnds&) const = default;
};

}  // namespace voxspring::layout
