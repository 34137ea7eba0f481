// A SIMD register that the shared physics computes with, as it does with a float.
//
// Include it after hwy/foreach_target.h. Each SIMD target gets its own copy of everything here and of
// spring.h, in namespace voxspring::HWY_NAMESPACE: a template that is compiled once, for the baseline,
// cannot be inlined together with the instructions of a better target.
#if defined(VOXSPRING_SIMD_LANES_INL_H) == defined(HWY_TARGET_TOGGLE)  // once a target: Highway's idiom
#ifdef VOXSPRING_SIMD_LANES_INL_H
#undef VOXSPRING_SIMD_LANES_INL_H
#else
#define VOXSPRING_SIMD_LANES_INL_H
#endif

#include <hwy/highway.h>

#include "backends/physics/portable.h"

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// As many scalars as a register of this target holds. Square root and division are those of IEEE 754
/// and nothing is contracted, so a lane has the same bits on every target, and those of a scalar.
template <class T>
struct Lanes {
    using Tag = hn::ScalableTag<T>;
    hn::Vec<Tag> v;

    static constexpr std::size_t count() { return hn::MaxLanes(Tag()); }
    HWY_INLINE explicit Lanes(hn::Vec<Tag> vector) : v(vector) {}
    HWY_INLINE explicit Lanes(T scalar) : v(hn::Set(Tag(), scalar)) {}
    /// `from` need not be aligned.
    static HWY_INLINE Lanes load(const T* from) { return Lanes(hn::LoadU(Tag(), from)); }
    HWY_INLINE void store(T* to) const { hn::StoreU(v, Tag(), to); }
};

template <class T>
HWY_INLINE Lanes<T> operator+(Lanes<T> a, Lanes<T> b) {
    return Lanes<T>(hn::Add(a.v, b.v));
}
template <class T>
HWY_INLINE Lanes<T> operator-(Lanes<T> a, Lanes<T> b) {
    return Lanes<T>(hn::Sub(a.v, b.v));
}
template <class T>
HWY_INLINE Lanes<T> operator*(Lanes<T> a, Lanes<T> b) {
    return Lanes<T>(hn::Mul(a.v, b.v));
}
template <class T>
HWY_INLINE Lanes<T> operator/(Lanes<T> a, Lanes<T> b) {
    return Lanes<T>(hn::Div(a.v, b.v));
}
template <class T>
HWY_INLINE Lanes<T> sqrt(Lanes<T> a) {
    return Lanes<T>(hn::Sqrt(a.v));
}
/// `b` where `a` is NaN, like the scalar one.
template <class T>
HWY_INLINE Lanes<T> larger(Lanes<T> a, Lanes<T> b) {
    return Lanes<T>(hn::IfThenElse(hn::Gt(a.v, b.v), a.v, b.v));
}

/// Three registers: x, y and z of as many particles.
template <class T>
struct Lanes3 {
    Lanes<T> x, y, z;
};

template <class T>
HWY_INLINE Lanes3<T> operator+(Lanes3<T> a, Lanes3<T> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
HWY_INLINE Lanes3<T> operator-(Lanes3<T> a, Lanes3<T> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
HWY_INLINE Lanes3<T> operator*(Lanes3<T> a, Lanes<T> s) {
    return {a.x * s, a.y * s, a.z * s};
}
/// Summed in the order of glm::dot.
template <class T>
HWY_INLINE Lanes<T> dot(Lanes3<T> a, Lanes3<T> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

}  // namespace voxspring::HWY_NAMESPACE

#undef VOXSPRING_SPRING_H
#undef VOXSPRING_PHYSICS_NAMESPACE
#define VOXSPRING_PHYSICS_NAMESPACE voxspring::HWY_NAMESPACE
#include "backends/physics/spring.h"

HWY_AFTER_NAMESPACE();

#endif
