// The arguments of the kernels that measure a card's limits (cuda/kernels/limits.cu). For device code and the
// host that launches it.
#pragma once

#ifndef __CUDACC_RTC__
#include <vector_types.h>
#endif

#include <cstddef>

namespace voxspring::cuda {

/// The data that a pass moves: arrays of `count` words of 16 bytes. `written` may be one of those that are
/// read.
struct Sweep {
    const float4* first;
    const float4* second;  ///< the second array read, if there are two
    float4* written;
    std::size_t count;
    /// `shift` is zero, and `impossible` is a sum that never occurs. The compiler knows neither, so every
    /// pass has to read memory anew.
    std::size_t shift;
    float impossible;
};

/// Independent sums per thread. With 8 warps or more per scheduler, a multiply-add is then ready in every
/// cycle.
inline constexpr int limit_sums = 8;
inline constexpr int limit_multiply_adds = 2048;  ///< per sum and repetition

}  // namespace voxspring::cuda
