// Kernels that measure a card's limits (cuda/device/limits.cpp). THREADS, the threads per block, is the only
// macro.
#include "cuda/kernels/exchange.h"
#include "cuda/kernels/limits.h"

namespace voxspring::cuda {

#define KERNEL extern "C" __global__ void __launch_bounds__(THREADS)

KERNEL do_nothing() {}

__device__ inline float4 operator-(float4 a, float4 b) {
    return make_float4(a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w);
}

/// Makes `passes` passes. A pass reads one or two arrays and writes one or none, past L1 and in words of 16
/// bytes, of which each thread moves `words` at a time. A launch makes many passes, since a pass within the
/// cache takes hardly longer than a launch. In a grid of several rows, each row makes one pass; a grid of few
/// blocks goes through the arrays in strides.
template <int reads, bool writes, int words>
__device__ void sweep(int passes, const Sweep& arrays) {
    const std::size_t stride = std::size_t(gridDim.x) * THREADS * words;
    float4 none = make_float4(0, 0, 0, 0);
    for (int n = 0; n < passes; ++n) {
        const std::size_t shift = (blockIdx.y + std::size_t(n)) * arrays.shift;
        for (std::size_t i = std::size_t(blockIdx.x) * THREADS * words + threadIdx.x; i < arrays.count;
             i += stride) {
            float4 word[words];
#pragma unroll
            for (int w = 0; w < words; ++w) word[w] = __ldcg(arrays.first + shift + i + w * THREADS);
            if constexpr (reads == 2) {
                float4 other[words];
#pragma unroll
                for (int w = 0; w < words; ++w) other[w] = __ldcg(arrays.second + shift + i + w * THREADS);
#pragma unroll
                for (int w = 0; w < words; ++w) word[w] = word[w] - other[w];
            }
#pragma unroll
            for (int w = 0; w < words; ++w) {
                if constexpr (writes) {
                    __stcg(arrays.written + i + w * THREADS, word[w]);
                } else {
                    none = none - word[w];
                }
            }
        }
    }
    if (!writes && none.x + none.y + none.z + none.w == arrays.impossible) *arrays.written = none;
}

// The digits of a name: how many arrays a pass reads and writes, and the words per thread.
KERNEL sweep_1_0_1(int passes, Sweep arrays) { sweep<1, false, 1>(passes, arrays); }
KERNEL sweep_1_0_2(int passes, Sweep arrays) { sweep<1, false, 2>(passes, arrays); }
KERNEL sweep_1_1_1(int passes, Sweep arrays) { sweep<1, true, 1>(passes, arrays); }
KERNEL sweep_1_1_2(int passes, Sweep arrays) { sweep<1, true, 2>(passes, arrays); }
KERNEL sweep_2_1_1(int passes, Sweep arrays) { sweep<2, true, 1>(passes, arrays); }
KERNEL sweep_2_1_2(int passes, Sweep arrays) { sweep<2, true, 2>(passes, arrays); }

/// All blocks of a cooperative launch meet `barriers` times. `arrived` counts the arrivals of blocks at
/// barriers, over all launches. `before`: its value after the earlier launches.
KERNEL meet(int barriers, std::uint32_t* arrived, std::uint32_t before) {
    for (int n = 1; n <= barriers; ++n) {
        const std::uint32_t wanted = before + std::uint32_t(n) * gridDim.x;
        __syncthreads();
        if (threadIdx.x == 0) {
            asm volatile("red.release.gpu.global.add.u32 [%0], 1;" ::"l"(arrived) : "memory");
            std::uint32_t count = 0;
            do {
                asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(count) : "l"(arrived) : "memory");
            } while (int(count - wanted) < 0);
        }
        __syncthreads();
    }
}

/// Each thread of a block forms a ring with the threads of the same number in all other blocks. In each
/// exchange it sends a point and waits for those of its two neighbours in the ring. Tags begin at `tag` + 1.
KERNEL exchange(TaggedPoint* points, int exchanges, std::uint32_t tag) {
    const unsigned before = (blockIdx.x + gridDim.x - 1) % gridDim.x, after = (blockIdx.x + 1) % gridDim.x;
    Vector<float> point{0, 0, 0};
    for (int n = 1; n <= exchanges; ++n) {
        TaggedPoint* const half = points + (n % 2) * gridDim.x * blockDim.x + threadIdx.x;
        publish_if(true, half + blockIdx.x * blockDim.x, point, tag + std::uint32_t(n));
        TaggedPoint left{}, right{};
        do {
            left = load_word_gpu(half + before * blockDim.x);
            right = load_word_gpu(half + after * blockDim.x);
        } while (left.tag != tag + std::uint32_t(n) || right.tag != tag + std::uint32_t(n));
        // The sum makes the next exchange depend on this one, so that it does not begin before this one is
        // over.
        point = left.point + right.point;
    }
}

/// Computes sums and writes none, but the compiler cannot know that: the sums converge to 2, so that `total`
/// never equals `impossible`. The multiply-adds are fused in the source, because the compiler must not fuse
/// any.
template <class Real>
__device__ void multiply_add(int repetitions, Real factor, Real impossible, Real* result) {
    Real sum[limit_sums];
    for (int s = 0; s < limit_sums; ++s) sum[s] = Real(threadIdx.x + s);
    for (int n = 0; n < repetitions; ++n) {
#pragma unroll 16
        for (int m = 0; m < limit_multiply_adds; ++m) {
#pragma unroll
            for (int s = 0; s < limit_sums; ++s) sum[s] = std::fma(sum[s], factor, Real(1));
        }
    }
    Real total = 0;
    for (int s = 0; s < limit_sums; ++s) total += sum[s];
    if (total == impossible) *result = total;
}
KERNEL multiply_add_float32(int repetitions, float factor, float impossible, float* result) {
    multiply_add(repetitions, factor, impossible, result);
}
KERNEL multiply_add_float64(int repetitions, double factor, double impossible, double* result) {
    multiply_add(repetitions, factor, impossible, result);
}

}  // namespace voxspring::cuda
