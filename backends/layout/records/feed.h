// Particles whose displacements a feed reads out (backends/facets.h), as devices read them.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// A particle of a feed. In GLSL: vec3, uint.
template <class Real>
struct alignas(4 * sizeof(Real)) FedWord {
    /// Subtracted from the stored vector to get a displacement: the rest position, or 0 if displacements are
    /// stored.
    Vector<Real> rest;
    std::uint32_t word;
    bool operator==(const FedWord&) const = default;
};

}  // namespace voxspring::layout
