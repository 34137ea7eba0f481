// What C++, CUDA and GLSL need in order to compile the same formulas.
//
// The headers of this folder with formulas (spring.h) use only what the three languages share: arguments by
// value, `dot`, `sqrt`, no references and no namespaces inside. A function is declared
//
//     SHARED(Vec3) name(Vec3 x, Real k) { ... }
//
// In C++ and CUDA this is a function template over its scalar and vector type, so that float, double and a
// SIMD register all run the same source. In GLSL it is a plain function of float and vec3 or, with
// VOXSPRING_FLOAT64, of double and dvec3.
#ifndef VOXSPRING_PORTABLE_H
#define VOXSPRING_PORTABLE_H

#ifdef VOXSPRING_GLSL

#define SHARED(ReturnType) ReturnType
#define SHARED_SCALAR(ReturnType) ReturnType
#define SHARED_VECTOR(ReturnType) ReturnType
#ifdef VOXSPRING_FLOAT64
#define Real double
#define Vec2 dvec2
#define Vec3 dvec3
#define Vec4 dvec4
#else
#define Real float
#define Vec2 vec2
#define Vec3 vec3
#define Vec4 vec4
#endif
#define larger max
/// Stands before a local variable that must be rounded in the same way wherever its expression is compiled.
/// Otherwise a compiler might fuse a multiply-add in one place and not in another. In C++ and CUDA compiler
/// flags prevent that.
#define PRECISE precise

#else

#include <cmath>

#define PRECISE
/// The namespace of the formulas. SIMD code compiles them once per instruction set, each time in another
/// namespace.
#define VOXSPRING_PHYSICS_NAMESPACE voxspring

#ifdef __CUDACC__
#define VOXSPRING_HOST_DEVICE __host__ __device__
#else
#define VOXSPRING_HOST_DEVICE
#endif

/// Declares a function with vector and scalar arguments.
#define SHARED(ReturnType)            \
    template <class Vec3, class Real> \
    VOXSPRING_HOST_DEVICE inline ReturnType
/// Declares a function with vector arguments only.
#define SHARED_VECTOR(ReturnType) \
    template <class Vec3>         \
    VOXSPRING_HOST_DEVICE inline ReturnType
/// Declares a function with scalar arguments only.
#define SHARED_SCALAR(ReturnType) \
    template <class Real>         \
    VOXSPRING_HOST_DEVICE inline ReturnType

namespace voxspring {

using std::fma;
using std::sqrt;

/// The larger of two numbers; `b` if `a` is NaN, like GLSL's max on every driver tried.
VOXSPRING_HOST_DEVICE inline float larger(float a, float b) { return a > b ? a : b; }
VOXSPRING_HOST_DEVICE inline double larger(double a, double b) { return a > b ? a : b; }

}  // namespace voxspring

#endif
#endif
