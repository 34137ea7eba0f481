// Converts between the vectors of the host's float64 state and those of a device.
#pragma once

#include <glm/vec3.hpp>

#include "backends/layout/records/particle.h"

namespace voxspring::layout {

template <class Real>
Vector<Real> vector_of(const glm::dvec3& v) {
    return {Real(v.x), Real(v.y), Real(v.z)};
}

template <class Real>
glm::dvec3 dvec_of(const Vector<Real>& v) {
    return {double(v.x), double(v.y), double(v.z)};
}

}  // namespace voxspring::layout
