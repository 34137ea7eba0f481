// What kernels read and write, as plain C++ so that tests run the kernels' bodies without a device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "backends/physics/portable.h"

namespace voxspring::cuda {

template <class Real>
struct Vector {
    Real x, y, z;
    bool operator==(const Vector&) const = default;
};

template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> operator+(Vector<Real> a, Vector<Real> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> operator-(Vector<Real> a, Vector<Real> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> operator*(Vector<Real> v, Real s) {
    return {v.x * s, v.y * s, v.z * s};
}

/// a s + b, each component rounded once.
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> fused(Vector<Real> a, Real s, Vector<Real> b) {
    return {std::fma(a.x, s, b.x), std::fma(a.y, s, b.y), std::fma(a.z, s, b.z)};
}

/// A position (or displacement; formulation.h) and the bits that go with it in one word of 16 or 32 bytes: a
/// neighbour mask (implicit) or the counters of its lists (explicit), with ACTIVE_BIT and PINNED_BIT of
/// neighbours.h in either case. A word of low parts has no bits.
template <class Real>
struct alignas(16) Word {
    using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
    Vector<Real> position;
    Bits bits;
    bool operator==(const Word&) const = default;
};

/// A word as a kernel holds it in registers.
template <class Real>
struct Particle {
    Vector<Real> position;
    std::uint32_t bits;
};

/// One spring of a list.
template <class Real>
struct alignas(2 * sizeof(Real)) SpringConstants {
    Real stiffness;
    /// As unit_pull() takes it. Where that is as measured_length() gives it on the device, its square until
    /// then (measure_rest_lengths).
    Real rest_length;
};

/// How the ends of a spring lie at rest: RestSpring (problem.h) of particle i and its neighbour j.
template <class Real>
struct alignas(4 * sizeof(Real)) SpringRest {
    Vector<Real> offset;  ///< X_j - X_i
    Real deficit;         ///< l^2 - |offset|^2
    bool operator==(const SpringRest&) const = default;
};

/// A direction code of a list entry (LISTED_INDEX_BITS of neighbours.h) is less than this.
inline constexpr int direction_codes = 32;

/// The two particles of a spring.
struct alignas(8) SpringEnds {
    std::uint32_t first, second;
    bool operator==(const SpringEnds&) const = default;
};

/// What the particles of a slice have in common (delta.h).
struct alignas(16) Slice {
    std::int32_t list;        ///< of the particle before the slice; -1: there is none
    std::uint32_t starts;     ///< bit l: particle l has the list behind that of the particle before it
    std::uint32_t own_begin;  ///< where its springs beyond the lattice begin, in slots of a slice
    std::uint32_t own_slots;  ///< slots a particle; 0: no particle of the slice has such a spring
    bool operator==(const Slice&) const = default;
};

/// Four rows of a list of deltas (delta.h).
struct alignas(16) FourDeltas {
    std::int32_t row[4];
    bool operator==(const FourDeltas&) const = default;
};

/// Where a block of an implicit kernel starts, in voxels.
struct alignas(16) BlockOrigin {
    int x, y, z;
    int place;  ///< of the block (BlockGrid of backends/layout/layout.h)
    bool operator==(const BlockOrigin&) const = default;
};

#ifdef __CUDACC__
__device__ inline Particle<float> unpacked(float4 v) { return {{v.x, v.y, v.z}, __float_as_uint(v.w)}; }
__device__ inline Particle<double> unpacked(double2 a, double2 b) {
    return {{a.x, a.y, b.x}, unsigned(__double2loint(b.y))};
}
#endif

// A word moves in accesses of 16 bytes. In host code there is one kind of memory.

/// Global memory past L1: ld.global.cg.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> load_past_l1(const Word<Real>* word) {
#ifdef __CUDA_ARCH__
    if constexpr (sizeof(Real) == sizeof(float)) {
        return unpacked(__ldcg(reinterpret_cast<const float4*>(word)));
    } else {
        const auto* half = reinterpret_cast<const double2*>(word);
        return unpacked(__ldcg(half), __ldcg(half + 1));
    }
#else
    return {word->position, std::uint32_t(word->bits)};
#endif
}

template <class Real>
VOXSPRING_HOST_DEVICE bool same_bits(Real a, Real b) {
    if constexpr (sizeof(Real) == sizeof(float)) {
        return __builtin_bit_cast(std::uint32_t, a) == __builtin_bit_cast(std::uint32_t, b);
    } else {
        return __builtin_bit_cast(std::uint64_t, a) == __builtin_bit_cast(std::uint64_t, b);
    }
}
template <class Real>
VOXSPRING_HOST_DEVICE bool same_bits(Vector<Real> a, Vector<Real> b) {
    return same_bits(a.x, b.x) && same_bits(a.y, b.y) && same_bits(a.z, b.z);
}

/// Memory that the kernel does not write, through L1: ld.global.nc.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> load_through_l1(const Word<Real>* word) {
#ifdef __CUDA_ARCH__
    if constexpr (sizeof(Real) == sizeof(float)) {
        return unpacked(__ldg(reinterpret_cast<const float4*>(word)));
    } else {
        const auto* half = reinterpret_cast<const double2*>(word);
        return unpacked(__ldg(half), __ldg(half + 1));
    }
#else
    return {word->position, std::uint32_t(word->bits)};
#endif
}

template <class Real>
VOXSPRING_HOST_DEVICE void store(Word<Real>* word, Particle<Real> p) {
#ifdef __CUDA_ARCH__
    if constexpr (sizeof(Real) == sizeof(float)) {
        *reinterpret_cast<float4*>(word) =
            make_float4(p.position.x, p.position.y, p.position.z, __uint_as_float(p.bits));
    } else {
        auto* half = reinterpret_cast<double2*>(word);
        half[0] = make_double2(p.position.x, p.position.y);
        half[1] = make_double2(p.position.z, __hiloint2double(0, int(p.bits)));
    }
#else
    *word = {p.position, p.bits};
#endif
}

}  // namespace voxspring::cuda
