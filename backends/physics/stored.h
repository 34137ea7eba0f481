// Rounds numbers to a backend's precision, for code that needs the rounded number in float64 or the rounding
// error.
//
// At -O2 and -O3, GCC 12 vectorises straight-line code wrongly: it leaves out both conversions of
// double(float(x)) if they are done for two neighbouring numbers, so that x - double(float(x)) is 0. A plain
// conversion to float is safe if its result is not converted back to double.
#pragma once

#include <glm/vec3.hpp>

namespace voxspring {

/// `value` rounded to Real. Because the object is volatile, the compiler cannot leave the rounding out.
template <class Real>
double stored_as(double value) {
    const volatile Real stored = Real(value);
    return double(stored);
}
template <class Real>
glm::dvec3 stored_as(const glm::dvec3& v) {
    return {stored_as<Real>(v.x), stored_as<Real>(v.y), stored_as<Real>(v.z)};
}

/// What rounding `value` to Real loses: value = Real(value) + lost_by<Real>(value), exactly.
template <class Real>
double lost_by(double value) {
    return value - stored_as<Real>(value);
}
template <class Real>
glm::dvec3 lost_by(const glm::dvec3& v) {
    return v - stored_as<Real>(v);
}

}  // namespace voxspring
