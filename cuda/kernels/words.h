// How kernels read and write words, as plain C++ so that tests run the kernels' bodies without a device.
#pragma once

#include "backends/layout/records/particle.h"

namespace voxspring::cuda {

/// A word as a kernel holds it in registers.
template <class Real>
struct Particle {
    Vector<Real> position;
    std::uint32_t bits;
};

#ifdef __CUDACC__
__device__ inline Particle<float> unpacked(float4 v) { return {{v.x, v.y, v.z}, __float_as_uint(v.w)}; }
__device__ inline Particle<double> unpacked(double2 a, double2 b) {
    return {{a.x, a.y, b.x}, unsigned(__double2loint(b.y))};
}
#endif

// A word moves in accesses of 16 bytes. The host has one kind of memory alone.

/// Reads global memory past L1: ld.global.cg.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> load_past_l1(const ParticleRecord<Real>* word) {
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

/// Reads memory that the kernel does not write, through L1: ld.global.nc.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> load_through_l1(const ParticleRecord<Real>* word) {
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
VOXSPRING_HOST_DEVICE void store(ParticleRecord<Real>* word, Particle<Real> p) {
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
