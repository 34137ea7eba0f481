// The spring force of spring.h, computed from the inverse square root that GPUs have in hardware. For C++,
// CUDA and GLSL.
//
// With r = 1/sqrt(|d|^2) the force density k (l - |d|) / |d| is k (l - |d|^2 r) r, which needs no IEEE root
// and no division. r is approximate (in float32 to about 2^-22.9 on NVIDIA), so rest lengths are measured in
// the same way: l is measured_length(l^2) on the same device. If |d|^2 has the bits of l^2, l and |d|^2 r are
// then the same number, and the force is zero to the bit, whatever the error of r. Away from rest the force
// is that of a spring whose rest length is off by about one unit in the last place.
//
// In host code r is exact up to rounding, so that tests can run the same source without a device.
#ifndef VOXSPRING_INVERSE_ROOT_H
#define VOXSPRING_INVERSE_ROOT_H

#include "portable.h"

#ifndef VOXSPRING_GLSL
#include <cmath>
#endif

#ifdef VOXSPRING_GLSL
// C++ and CUDA have the same functions below, with comments that describe them.
Real inverse_root(Real squared) { return inversesqrt(squared); }
Real rounded_product(Real a, Real b) {
    precise Real product = a * b;
    return product;
}
Real squared_length(Real x, Real y, Real z, Real shortest_squared) {
#ifdef VOXSPRING_FLOAT64
    return larger(fma(x, x, fma(y, y, z * z)), shortest_squared);
#else
    return fma(x, x, fma(y, y, fma(z, z, shortest_squared)));
#endif
}
Real fast_reciprocal(Real value) { return Real(1) / value; }
Real fast_series_stiffness(Real compliance_a, Real compliance_b) {
    return Real(2) / (compliance_a + compliance_b);
}
#else

namespace voxspring {

/// 1 / sqrt(squared), for a normal positive number.
VOXSPRING_HOST_DEVICE inline float inverse_root(float squared) {
#ifdef __CUDA_ARCH__
    // rsqrtf() takes two more instructions, to handle denormal numbers.
    float root;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(squared));
    return root;
#else
    return 1 / std::sqrt(squared);
#endif
}

/// One step of a third-order iteration for 1 / sqrt(squared): if `root` has 20 correct bits, the result has
/// 53.
VOXSPRING_HOST_DEVICE inline double refined_inverse_root(double squared, double root) {
    const double error = std::fma(-(squared * root), root, 1.0);
    return std::fma(root * error, std::fma(0.375, error, 0.5), root);
}

VOXSPRING_HOST_DEVICE inline double inverse_root(double squared) {
#ifdef __CUDA_ARCH__
    // rsqrt(double) would branch for numbers that are not normal.
    double root;
    asm("rsqrt.approx.ftz.f64 %0, %1;" : "=d"(root) : "d"(squared));
    return refined_inverse_root(squared, root);
#else
    return 1 / std::sqrt(squared);
#endif
}

/// a * b, rounded, and never fused with an addition into one instruction: the difference of two equal
/// products must be zero.
VOXSPRING_HOST_DEVICE inline float rounded_product(float a, float b) {
#ifdef __CUDA_ARCH__
    return __fmul_rn(a, b);
#else
    return a * b;
#endif
}

VOXSPRING_HOST_DEVICE inline double rounded_product(double a, double b) {
#ifdef __CUDA_ARCH__
    return __dmul_rn(a, b);
#else
    return a * b;
#endif
}

/// x^2 + y^2 + z^2, kept above zero by `shortest_squared`. In float32 `shortest_squared` is added, which
/// takes no extra instruction and is lost in rounding unless the ends of a spring nearly coincide. In float64
/// the larger of the two numbers is taken, as in spring_force().
VOXSPRING_HOST_DEVICE inline float squared_length(float x, float y, float z, float shortest_squared) {
    return std::fma(x, x, std::fma(y, y, std::fma(z, z, shortest_squared)));
}

VOXSPRING_HOST_DEVICE inline double squared_length(double x, double y, double z, double shortest_squared) {
    return larger(std::fma(x, x, std::fma(y, y, z * z)), shortest_squared);
}

/// One step of a third-order iteration for 1 / value: if `reciprocal` has 20 correct bits, the result has 53.
VOXSPRING_HOST_DEVICE inline double refined_reciprocal(double value, double reciprocal) {
    const double error = std::fma(-value, reciprocal, 1.0);
    return std::fma(reciprocal, std::fma(error, error, error), reciprocal);
}

/// 1 / value, for a normal positive number: in float32 to about 2^-23 on NVIDIA.
VOXSPRING_HOST_DEVICE inline float fast_reciprocal(float value) {
#ifdef __CUDA_ARCH__
    float reciprocal;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(reciprocal) : "f"(value));
    return reciprocal;
#else
    return 1 / value;
#endif
}

VOXSPRING_HOST_DEVICE inline double fast_reciprocal(double value) {
#ifdef __CUDA_ARCH__
    double reciprocal;
    asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(reciprocal) : "d"(value));
    return refined_reciprocal(value, reciprocal);
#else
    return 1 / value;
#endif
}

/// series_stiffness() without an IEEE division. A caller may pass two compliances of zero if no particles are
/// there; it then drops the result. On a device this result is an infinity or, in float64, NaN. On a host,
/// whose sanitizers would stop at the division by zero, it is zero.
VOXSPRING_HOST_DEVICE inline float fast_series_stiffness(float compliance_a, float compliance_b) {
#ifdef __CUDA_ARCH__
    return __fdividef(2.0F, compliance_a + compliance_b);
#else
    const float compliance = compliance_a + compliance_b;
    return compliance == 0 ? 0 : 2 / compliance;
#endif
}

VOXSPRING_HOST_DEVICE inline double fast_series_stiffness(double compliance_a, double compliance_b) {
#ifdef __CUDA_ARCH__
    return 2 * fast_reciprocal(compliance_a + compliance_b);
#else
    const double compliance = compliance_a + compliance_b;
    return compliance == 0 ? 0 : 2 * fast_reciprocal(compliance);
#endif
}

}  // namespace voxspring
#endif

#ifndef VOXSPRING_GLSL
namespace voxspring {
#endif

/// The length whose square is `squared`, computed by inverse_root().
SHARED_SCALAR(Real)
measured_length(Real squared) { return rounded_product(squared, inverse_root(squared)); }

/// The force density of a spring of stiffness 1: (l - |d|) / |d|. `squared` is |d|^2, `inverse` its
/// inverse_root(), and `rest_length` is l from measured_length().
SHARED_SCALAR(Real)
unit_force_density(Real squared, Real rest_length, Real inverse) {
    PRECISE Real density = (rest_length - rounded_product(squared, inverse)) * inverse;
    return density;
}

/// strain_density() at stiffness 1, computed from |d|^2, the rest length l and `deficit` = l^2 - |d|^2:
/// deficit / ((l + |d|) |d|). Near rest only `deficit` is small. So the relative error of the force is that
/// of the root, and at rest the force is zero.
SHARED_SCALAR(Real)
unit_strain_density(Real squared, Real rest_length, Real deficit) {
    PRECISE Real inverse = inverse_root(squared);
    PRECISE Real density = deficit * inverse * fast_reciprocal(fma(squared, inverse, rest_length));
    return density;
}

#ifndef VOXSPRING_GLSL
/// unit_strain_density(), in float32 by another formula, deficit / (|d|^2 + l |d|). This saves a
/// multiplication, because the hardware has an instruction for the square root.
VOXSPRING_HOST_DEVICE inline float lean_strain_density(float squared, float rest_length, float deficit) {
#ifdef __CUDA_ARCH__
    float length;
    asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(length) : "f"(squared));
#else
    const float length = std::sqrt(squared);
#endif
    return deficit * fast_reciprocal(std::fma(rest_length, length, squared));
}

VOXSPRING_HOST_DEVICE inline double lean_strain_density(double squared, double rest_length, double deficit) {
    return unit_strain_density(squared, rest_length, deficit);
}

}  // namespace voxspring
#endif
#endif
