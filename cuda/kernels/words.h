// How kernels read and write words (ParticleRecord: a particle's position and bits). The host has plain C++
// versions, so that tests can run the kernels' bodies without a device.
#pragma once

#include "backends/layout/records/particle.h"
#include "cuda/kernels/layout.h"

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

// On a device, words are loaded and stored by accesses of 16 bytes. On the host, loads are plain copies.

#ifdef __CUDACC__
// With DEPENDENT_LAUNCH (entry.h) the previous step may still write words while this one begins. So the
// compiler must not move a load before the wait for that step: loads are volatile. Nor may a load be
// ld.global.nc, which is for memory that nobody writes while the kernel runs.
#ifdef DEPENDENT_LAUNCH
#define ORDERED_LOAD(name, cached)                                                                  \
    __device__ inline float4 name(const float4* p) {                                                \
        float4 v;                                                                                   \
        asm volatile("ld.global" cached ".v4.f32 {%0, %1, %2, %3}, [%4];"                           \
                     : "=f"(v.x), "=f"(v.y), "=f"(v.z), "=f"(v.w)                                   \
                     : "l"(p));                                                                     \
        return v;                                                                                   \
    }                                                                                               \
    __device__ inline double2 name(const double2* p) {                                              \
        double2 v;                                                                                  \
        asm volatile("ld.global" cached ".v2.f64 {%0, %1}, [%2];" : "=d"(v.x), "=d"(v.y) : "l"(p)); \
        return v;                                                                                   \
    }
ORDERED_LOAD(ordered_past_l1, ".cg")
ORDERED_LOAD(ordered_through_l1, "")
#undef ORDERED_LOAD
#else
template <class T>
__device__ T ordered_past_l1(const T* p) {
    return __ldcg(p);
}
template <class T>
__device__ T ordered_through_l1(const T* p) {
    return __ldg(p);
}
#endif
#endif

/// Reads global memory past L1: ld.global.cg.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> load_past_l1(const ParticleRecord<Real>* word) {
#ifdef __CUDA_ARCH__
    if constexpr (sizeof(Real) == sizeof(float)) {
        return unpacked(ordered_past_l1(reinterpret_cast<const float4*>(word)));
    } else {
        const auto* half = reinterpret_cast<const double2*>(word);
        return unpacked(ordered_past_l1(half), ordered_past_l1(half + 1));
    }
#else
    return {word->position, word->particle_bits()};
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

/// Reads memory that the kernel does not write, through L1: ld.global.nc or, with DEPENDENT_LAUNCH,
/// ld.global.
template <class Real>
VOXSPRING_HOST_DEVICE Particle<Real> load_through_l1(const ParticleRecord<Real>* word) {
#ifdef __CUDA_ARCH__
    if constexpr (sizeof(Real) == sizeof(float)) {
        return unpacked(ordered_through_l1(reinterpret_cast<const float4*>(word)));
    } else {
        const auto* half = reinterpret_cast<const double2*>(word);
        return unpacked(ordered_through_l1(half), ordered_through_l1(half + 1));
    }
#else
    return {word->position, word->particle_bits()};
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
        half[1] = make_double2(p.position.z, __hiloint2double(int(upper_half_of_one), int(p.bits)));
    }
#else
    *word = {p.position, ParticleRecord<Real>::with(p.bits)};
#endif
}

}  // namespace voxspring::cuda
