// The divergence monitor's check of the state on the device: is every particle finite and slow enough?
#pragma once

#include <cstdint>

#include "backends/layout/records/particle.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/divergence_check.h"

namespace voxspring::cuda {

struct DivergenceCheck {
    std::int64_t step;         ///< the step after which it checks
    std::int64_t last_check;   ///< the step of the check before
    double largest_increment;  ///< |x(t) - x(t - dt)|
};

/// Enqueues a check. An increment is the difference from `before` to `words`. If `before` is null, it is
/// three numbers of `increment`, `pitch` elements apart. A word without bits is no particle. The caller fills
/// `first` with the largest numbers there are.
template <class Real>
void launch_divergence_check(const ParticleRecord<Real>* words, const ParticleRecord<Real>* before,
                             const Real* increment, std::size_t pitch, std::size_t count,
                             const DivergenceCheck& parameters, FirstDivergence* first, const Stream& stream);
/// launch_divergence_check() for positions in axes `pitch` apart. Elements without a particle neither move
/// nor are infinite.
template <class Real>
void launch_divergence_check_on_axes(const Real* now, const Real* before, const Real* increment,
                                     std::size_t pitch, std::size_t count, const DivergenceCheck& parameters,
                                     FirstDivergence* first, const Stream& stream);

}  // namespace voxspring::cuda
