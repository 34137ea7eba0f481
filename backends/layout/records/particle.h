// Vectors, and the word of 16 or 32 bytes in which memory holds a particle's position and bits. C++ and
// NVRTC, the run-time compiler of CUDA, read this file, like all files of this folder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "backends/physics/portable.h"

namespace voxspring::layout {

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

/// a s + b, with each component rounded once.
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> fused(Vector<Real> a, Real s, Vector<Real> b) {
    return {std::fma(a.x, s, b.x), std::fma(a.y, s, b.y), std::fma(a.z, s, b.z)};
}

/// The upper 32 bits of 1.0 in float64 (shaders/words.glsl).
inline constexpr std::uint32_t upper_half_of_one = 0x3FF00000u;

/// A position (or displacement; formulation.h) and the bits that go with it, in one word of 16 or 32 bytes.
/// With implicit addressing and with delta-compressed lists the bits are a neighbour mask; with other
/// neighbour lists they count the entries of the particle's list. In every case they include ACTIVE_BIT and,
/// if the particle is pinned, PINNED_BIT of neighbours.h. In the word for a displacement's low part
/// (`compensated`) particle_bits() is 0.
///
/// Shaders and kernels move words as vectors of numbers, and the fourth number has the bits. It must be a
/// normal number, so that no hardware flushes it to zero. In float32 ACTIVE_BIT makes it one. In float64 the
/// upper half of `bits` is the upper half of 1.0, and the lower half is particle_bits().
template <class Real>
struct alignas(16) ParticleRecord {
    using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
    Vector<Real> position;
    Bits bits;

    static VOXSPRING_HOST_DEVICE constexpr Bits with(std::uint32_t particle_bits) {
        if constexpr (sizeof(Real) == 4) {
            return particle_bits;
        } else {
            return std::uint64_t(upper_half_of_one) << 32 | particle_bits;
        }
    }
    VOXSPRING_HOST_DEVICE std::uint32_t particle_bits() const { return std::uint32_t(bits); }
    bool operator==(const ParticleRecord&) const = default;
};

}  // namespace voxspring::layout
