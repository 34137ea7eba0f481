// A spring in memory: the constants of its force, and the particles that it joins.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// The constants of one spring of a list.
template <class Real>
struct alignas(2 * sizeof(Real)) SpringConstants {
    Real stiffness;
    /// The rest length: in formulations by increments the length itself, otherwise the length that the device
    /// measures with measured_length(). Until it has done so (calibrate_rest_lengths), this is the square of
    /// the length.
    Real rest_length;
};

/// How the ends i and j of a spring lie at rest. RestSpring (problem.h) says the same, but has the offset
/// from j to i.
template <class Real>
struct alignas(4 * sizeof(Real)) SpringRest {
    Vector<Real> offset;  ///< X_j - X_i
    Real deficit;         ///< l^2 - |offset|^2
    bool operator==(const SpringRest&) const = default;
};

/// The number of direction codes. A code is the part of a list entry that says how the neighbour lies at rest
/// (LISTED_INDEX_BITS of neighbours.h).
inline constexpr int direction_codes = 32;

/// The two particles of a spring.
struct alignas(8) SpringEnds {
    std::uint32_t first, second;
    bool operator==(const SpringEnds&) const = default;
};

}  // namespace voxspring::layout
