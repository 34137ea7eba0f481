// Class Lanes: a SIMD register that can stand in for a scalar in the formulas of spring.h.
//
// Include this file after hwy/foreach_target.h. Each SIMD target gets a separate copy of everything here and
// of spring.h, in namespace voxspring::HWY_NAMESPACE: a template that is compiled once, for the baseline,
// cannot be inlined together with the instructions of a better target.
#if defined(VOXSPRING_SIMD_LANES_INL_H) == defined(HWY_TARGET_TOGGLE)  // once per target: Highway's idiom
#ifdef VOXSPRING_SIMD_LANES_INL_H
#undef VOXSPRING_SIMD_LANES_INL_H
#else
#define VOXSPRING_SIMD_LANES_INL_H
#endif

#include <hwy/highway.h>

#include <array>
#include <cstddef>

#include "backends/cpu/simd/root.h"
#include "backends/physics/portable.h"

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// The largest relative error of the approximate reciprocal and the approximate reciprocal root of this
/// target, as the processor's manual states it: for VRCP14PS with AVX-512, RCPPS with AVX2, SSE4 and SSSE3,
/// and FRECPE with NEON. For other targets it is that of Highway's emulation of the root.
constexpr double approximation_error =
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
    0x1p-14;
#elif HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_SSE4 || HWY_TARGET == HWY_SSSE3
    1.5 * 0x1p-12;
#elif HWY_TARGET == HWY_NEON
    0x1p-8;
#else
    0x1p-9;
#endif

/// A SIMD register of scalars, as wide as this target's registers are. No multiplication and addition are
/// fused, so with Root::exact a lane has the same bits on every target as a scalar computation has. The other
/// roots are for float32 only.
template <class Scalar, Root root>
struct Lanes {
    using T = Scalar;
    using Tag = hn::ScalableTag<T>;
    hn::Vec<Tag> v;

    static constexpr std::size_t count() { return hn::MaxLanes(Tag()); }
    HWY_INLINE explicit Lanes(hn::Vec<Tag> vector) : v(vector) {}
    HWY_INLINE explicit Lanes(T scalar) : v(hn::Set(Tag(), scalar)) {}
    /// `from` need not be aligned.
    static HWY_INLINE Lanes load(const T* from) { return Lanes(hn::LoadU(Tag(), from)); }
    HWY_INLINE void store(T* to) const { hn::StoreU(v, Tag(), to); }
};

template <class T, Root root>
HWY_INLINE Lanes<T, root> operator+(Lanes<T, root> a, Lanes<T, root> b) {
    return Lanes<T, root>(hn::Add(a.v, b.v));
}
template <class T, Root root>
HWY_INLINE Lanes<T, root> operator-(Lanes<T, root> a, Lanes<T, root> b) {
    return Lanes<T, root>(hn::Sub(a.v, b.v));
}
template <class T, Root root>
HWY_INLINE Lanes<T, root> operator*(Lanes<T, root> a, Lanes<T, root> b) {
    return Lanes<T, root>(hn::Mul(a.v, b.v));
}
template <class T, Root root>
HWY_INLINE Lanes<T, root> operator/(Lanes<T, root> a, Lanes<T, root> b) {
    if constexpr (root == Root::exact) {
        return Lanes<T, root>(hn::Div(a.v, b.v));
    } else {
        auto inverse = hn::ApproximateReciprocal(b.v);
        if constexpr (root == Root::refined) {
            const typename Lanes<T, root>::Tag tag;
            inverse = hn::Mul(inverse, hn::NegMulAdd(b.v, inverse, hn::Set(tag, T(2))));
        }
        return Lanes<T, root>(hn::Mul(a.v, inverse));
    }
}
template <class T, Root root>
HWY_INLINE Lanes<T, root> sqrt(Lanes<T, root> a) {
    if constexpr (root == Root::exact) {
        return Lanes<T, root>(hn::Sqrt(a.v));
    } else {
        auto inverse = hn::ApproximateReciprocalSqrt(a.v);
        if constexpr (root == Root::refined) {
            const typename Lanes<T, root>::Tag tag;
            const auto half = hn::Mul(hn::Mul(a.v, hn::Set(tag, T(0.5))), inverse);
            inverse = hn::Mul(inverse, hn::NegMulAdd(half, inverse, hn::Set(tag, T(1.5))));
        }
        return Lanes<T, root>(hn::Mul(a.v, inverse));
    }
}
/// The larger number in each lane; `b` where `a` is NaN, like the scalar larger() of portable.h.
template <class T, Root root>
HWY_INLINE Lanes<T, root> larger(Lanes<T, root> a, Lanes<T, root> b) {
#if HWY_ARCH_X86
    // One instruction, which returns its second operand if either operand is NaN or both are zero.
    return Lanes<T, root>(hn::Max(a.v, b.v));
#else
    return Lanes<T, root>(hn::IfThenElse(hn::Gt(a.v, b.v), a.v, b.v));
#endif
}

/// The vectors of several particles, one per lane: a register L each for x, y and z.
template <class L>
struct Lanes3 {
    L x, y, z;
};

template <class L>
HWY_INLINE Lanes3<L> operator+(Lanes3<L> a, Lanes3<L> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class L>
HWY_INLINE Lanes3<L> operator-(Lanes3<L> a, Lanes3<L> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class L>
HWY_INLINE Lanes3<L> operator-(Lanes3<L> a) {
    return {L(hn::Neg(a.x.v)), L(hn::Neg(a.y.v)), L(hn::Neg(a.z.v))};
}
template <class L>
HWY_INLINE Lanes3<L> operator*(Lanes3<L> a, L s) {
    return {a.x * s, a.y * s, a.z * s};
}
/// The dot product, summed in the order of glm::dot().
template <class L>
HWY_INLINE L dot(Lanes3<L> a, Lanes3<L> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <class L, class Pointer>
HWY_INLINE Lanes3<L> load3(const std::array<Pointer, 3>& from, std::ptrdiff_t i) {
    return {L::load(from[0] + i), L::load(from[1] + i), L::load(from[2] + i)};
}

template <class L>
HWY_INLINE void store3(Lanes3<L> v, const std::array<typename L::T*, 3>& to, std::ptrdiff_t i) {
    v.x.store(to[0] + i);
    v.y.store(to[1] + i);
    v.z.store(to[2] + i);
}

template <class L>
HWY_INLINE Lanes3<L> broadcast3(const std::array<typename L::T, 3>& v) {
    return {L(v[0]), L(v[1]), L(v[2])};
}

template <class L>
HWY_INLINE Lanes3<L> zero3() {
    return broadcast3<L>({0, 0, 0});
}

template <class L>
using MaskTag = hn::RebindToUnsigned<typename L::Tag>;

/// `a` in lanes that are `chosen`, otherwise `b`. The other value is dropped, even if it is a NaN.
template <class L, class Chosen>
HWY_INLINE Lanes3<L> select(Chosen chosen, Lanes3<L> a, Lanes3<L> b) {
    const auto m = hn::RebindMask(typename L::Tag(), chosen);
    return {L(hn::IfThenElse(m, a.x.v, b.x.v)), L(hn::IfThenElse(m, a.y.v, b.y.v)),
            L(hn::IfThenElse(m, a.z.v, b.z.v))};
}

}  // namespace voxspring::HWY_NAMESPACE

#undef VOXSPRING_SPRING_H
#undef VOXSPRING_PHYSICS_NAMESPACE
#define VOXSPRING_PHYSICS_NAMESPACE voxspring::HWY_NAMESPACE
#include "backends/physics/spring.h"

HWY_AFTER_NAMESPACE();

#endif
