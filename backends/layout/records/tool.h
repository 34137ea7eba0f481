// The particles that a tool holds, as devices read them, and the tool's forces.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

/// A particle that the tool holds. In GLSL: vec3, uint, vec3.
template <class Real>
struct alignas(4 * sizeof(Real)) HeldWord {
    Vector<Real> anchor;  ///< the particle's position or displacement when the tool took hold
    std::uint32_t word;
    alignas(4 * sizeof(Real)) Vector<Real> load;  ///< the particle's Problem::load
    bool operator==(const HeldWord&) const = default;
};

/// The force of the tool on a held particle in the latest step. In GLSL: vec4.
template <class Real>
struct alignas(4 * sizeof(Real)) HeldForce {
    Vector<Real> force;
};

/// The present state of the tool.
template <class Real>
struct alignas(16) ToolState {
    Vector<Real> moved;  ///< how far the tool has moved since it took hold
    Real stiffness;
};

}  // namespace voxspring::layout
