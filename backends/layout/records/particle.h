// A particle in memory: a vector, and the word that holds a position and its bits. Like all of this folder it
// is read by C++, nvcc and the run-time compiler.
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
struct alignas(16) ParticleRecord {
    using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
    Vector<Real> position;
    Bits bits;
    bool operator==(const ParticleRecord&) const = default;
};

}  // namespace voxspring::cuda
