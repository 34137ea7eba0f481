// The body of the divergence monitor's check: is every particle finite and slow enough?
#pragma once

#include "cuda/kernels/motion.h"

namespace voxspring::cuda {

/// `found`: the step of the first check that failed. `last_good`: the step of the check before that one.
struct FirstDivergence {
    long long last_good, found;
};

/// Whether a particle is not finite or moved too far.
template <class Real>
VOXSPRING_HOST_DEVICE bool beyond(Vector<Real> position, Vector<Real> v, Real max_squared) {
    const Real sum = position.x + position.y + position.z;
    // Written so that a NaN counts as diverged. For a finite sum, `sum - sum` is 0.
    return !(v.x * v.x + v.y * v.y + v.z * v.z <= max_squared) || !(sum - sum == Real(0));
}

/// Particles in words. By increments `before` is null and `increment` is used. A word whose bits are 0 holds
/// no particle.
template <class Real>
struct ParticlesInWords {
    const ParticleRecord<Real>* words;
    const ParticleRecord<Real>* before;
    const Real* increment;
    std::size_t pitch;

    VOXSPRING_HOST_DEVICE bool has_diverged(std::size_t i, Real max_squared) const {
        const Particle<Real> self = load_past_l1(words + i);
        if (self.bits == 0) return false;
        return beyond(self.position,
                      before != nullptr ? self.position - load_past_l1(before + i).position
                                        : load_axes(increment + i, pitch),
                      max_squared);
    }
};

/// Particles in a structure of arrays: x of `pitch` particles, then their y, their z, then x of the next
/// ones. By increments `before` is null and `increment` is used.
template <class Real>
struct ParticlesInAxes {
    const Real* now;
    const Real* before;
    const Real* increment;
    std::size_t pitch;

    VOXSPRING_HOST_DEVICE bool has_diverged(std::size_t i, Real max_squared) const {
        const std::size_t at = i / pitch * (3 * pitch) + i % pitch;
        const Vector<Real> position = load_axes(now + at, pitch);
        return beyond(
            position,
            before != nullptr ? position - load_axes(before + at, pitch) : load_axes(increment + at, pitch),
            max_squared);
    }
};

#ifdef __CUDACC__
/// Checks `count` particles after step `step`. `last_check`: the step of the check before this one.
template <class Particles, class Real>
__device__ void check_divergence(const Particles& particles, std::size_t count, Real max_squared,
                                 long long step, long long last_check, FirstDivergence* first) {
    bool diverged = false;
    const std::size_t threads = std::size_t(gridDim.x) * blockDim.x;
    for (std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x; i < count; i += threads)
        diverged = particles.has_diverged(i, max_squared) || diverged;
    if (__syncthreads_or(int(diverged)) != 0 && threadIdx.x == 0) {
        atomicMin(&first->found, step);
        atomicMin(&first->last_good, last_check);
    }
}
#endif

}  // namespace voxspring::cuda
