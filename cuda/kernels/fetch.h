// How kernels read memory: one type per path (past L1, through L1, through a texture). A kernel gets an
// object of such a type, which has 8 bytes, as an argument. Device code only.
#pragma once

#include "backends/layout/records/delta.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {

/// The built-in CUDA type by which an entry of a list is loaded in one access.
template <class Entry>
struct LoadedAs;
#define LOAD_AS(Entry, Vector) \
    template <>                \
    struct LoadedAs<Entry> {   \
        using type = Vector;   \
    };
LOAD_AS(std::uint32_t, unsigned)
LOAD_AS(SpringEnds, uint2)
LOAD_AS(SpringConstants<float>, float2)
LOAD_AS(SpringConstants<double>, double2)
LOAD_AS(FourDeltas, int4)
LOAD_AS(Slice, uint4)
#undef LOAD_AS

template <class Entry>
__device__ Entry list_entry_past_l1(const Entry* p) {
    using Vector = typename LoadedAs<Entry>::type;
    return __builtin_bit_cast(Entry, __ldcg(reinterpret_cast<const Vector*>(p)));
}
template <class Entry>
__device__ Entry list_entry_through_l1(const Entry* p) {
    using Vector = typename LoadedAs<Entry>::type;
    return __builtin_bit_cast(Entry, __ldg(reinterpret_cast<const Vector*>(p)));
}

/// Reads global memory past L1 (ld.global.cg), today's nearest equivalent to the uncached loads of 2008.
template <class Real>
struct PastL1 {
    const ParticleRecord<Real>* words;
    __device__ Particle<Real> at(int index, int dx) const {
        const ParticleRecord<Real>* row = words + index;
        return load_past_l1(row + dx);
    }
    template <class T>
    __device__ T entry(const T* p) const {
        return list_entry_past_l1(p);
    }
};

/// Reads global memory through L1 (load_through_l1()).
template <class Real>
struct ThroughL1 {
    const ParticleRecord<Real>* words;
    __device__ Particle<Real> at(int index, int dx) const {
        const ParticleRecord<Real>* row = words + index;
        return load_through_l1(row + dx);
    }
    template <class T>
    __device__ T entry(const T* p) const {
        return list_entry_through_l1(p);
    }
};

/// tex1Dfetch(), which the compiler may not move before the wait for the previous step (words.h).
__device__ inline float4 texel(cudaTextureObject_t texture, int index, float4) {
#ifdef DEPENDENT_LAUNCH
    float4 v;
    asm volatile("tex.1d.v4.f32.s32 {%0, %1, %2, %3}, [%4, {%5}];"
                 : "=f"(v.x), "=f"(v.y), "=f"(v.z), "=f"(v.w)
                 : "l"(texture), "r"(index));
    return v;
#else
    return tex1Dfetch<float4>(texture, index);
#endif
}
__device__ inline int4 texel(cudaTextureObject_t texture, int index, int4) {
#ifdef DEPENDENT_LAUNCH
    int4 v;
    asm volatile("tex.1d.v4.s32.s32 {%0, %1, %2, %3}, [%4, {%5}];"
                 : "=r"(v.x), "=r"(v.y), "=r"(v.z), "=r"(v.w)
                 : "l"(texture), "r"(index));
    return v;
#else
    return tex1Dfetch<int4>(texture, index);
#endif
}

/// Reads positions through a texture object (tex1Dfetch): one float4, or two int4 for float64. Lists are read
/// through L1. With ROWS, which repeats the paper of 2008, they are read past L1, since no cache served plain
/// loads then.
template <class Real>
struct ThroughTexture {
    cudaTextureObject_t texture;
    __device__ Particle<Real> at(int index, int dx) const {
        if constexpr (sizeof(ParticleRecord<Real>) == 16) {
            return unpacked(texel(texture, index + dx, float4{}));
        } else {
            const int4 a = texel(texture, 2 * (index + dx), int4{});
            const int4 b = texel(texture, 2 * (index + dx) + 1, int4{});
            return {{__hiloint2double(a.y, a.x), __hiloint2double(a.w, a.z), __hiloint2double(b.y, b.x)},
                    unsigned(b.z)};
        }
    }
    template <class T>
    __device__ T entry(const T* p) const {
#ifdef ROWS
        return list_entry_past_l1(p);
#else
        return list_entry_through_l1(p);
#endif
    }
};

}  // namespace voxspring::cuda
