// The divergence monitor's check of the state on the device: is every particle finite and slow enough?
#pragma once

#include <algorithm>
#include <cstdint>

#include "cuda/common/support_kernels.h"
#include "cuda/kernels/divergence_check.h"

namespace voxspring::cuda {

struct DivergenceCheck {
    std::int64_t step;         ///< the check is made after this step
    std::int64_t last_check;   ///< the step of the previous check
    double largest_increment;  ///< the largest |x(t) - x(t - dt)| that passes
};

/// Enqueues a check of the first `count` elements of `particles` by `kernel`: check_words or check_axes,
/// whichever takes their type. In a structure of arrays, elements without a particle pass: they are finite
/// and do not move. Before the first check the caller fills `first` with the largest numbers of its type.
template <class Real, template <class> class Particles>
void launch_divergence_check(const Kernel& kernel, const Particles<Real>& particles, std::size_t count,
                             const DivergenceCheck& parameters, FirstDivergence* first,
                             const Stream& stream) {
    if (count == 0) return;
    // Few blocks: each does two atomic operations if it finds a divergence.
    constexpr std::size_t block = 256, max_blocks = 1024;
    const auto blocks = unsigned(std::min(max_blocks, (count + block - 1) / block));
    const auto max_squared = Real(parameters.largest_increment * parameters.largest_increment);
    const auto step = static_cast<long long>(parameters.step);
    const auto last_check = static_cast<long long>(parameters.last_check);
    kernel.launch(stream, dim3(blocks), dim3(unsigned(block)), 0, particles, count, max_squared, step,
                  last_check, first);
}

}  // namespace voxspring::cuda
