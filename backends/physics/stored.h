// Rounding to a backend's precision for code that goes on to use what the rounding lost.
//
// GCC 12 drops double(float(x)) of two neighbouring numbers at -O2 and -O3: its vectoriser of straight-line
// code takes the two conversions for none. Then x - double(float(x)) is 0. Plain conversions are safe if
// nothing is widened again.
#pragma once

#include <glm/vec3.hpp>

namespace voxspring {

/// `value` rounded to Real. An optimiser must not omit an access to a volatile object.
template <class Real>
double stored_as(double value) {
    const volatile Real stored = Real(value);
    return double(stored);
}
template <class Real>
glm::dvec3 stored_as(const glm::dvec3& v) {
    return {stored_as<Real>(v.x), stored_as<Real>(v.y), stored_as<Real>(v.z)};
}

/// What the rounding lost: value = Real(value) + lost_by<Real>(value), exactly.
template <class Real>
double lost_by(double value) {
    return value - stored_as<Real>(value);
}
template <class Real>
glm::dvec3 lost_by(const glm::dvec3& v) {
    return v - stored_as<Real>(v);
}

}  // namespace voxspring
