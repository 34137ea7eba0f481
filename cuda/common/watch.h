// A look at the state on the device: is every particle finite and slow enough?
#pragma once

#include <cstdint>

#include "backends/layout/records/particle.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

struct Look {
    std::int64_t step;         ///< at which it is
    std::int64_t last;         ///< of the look before
    double largest_increment;  ///< |x(t) - x(t - dt)|
};

/// On the device: the first look that found fault, and the one before it.
struct Fault {
    long long step, last;
};

/// Enqueues it. Increments are those from `before` to `words` or, where that is null, `increment`, an axis
/// every `pitch` elements. A word without bits is no particle. `fault` starts with the largest numbers there
/// are.
template <class Real>
void look_at(const ParticleRecord<Real>* words, const ParticleRecord<Real>* before, const Real* increment,
             std::size_t pitch, std::size_t count, const Look& look, Fault* fault, const Stream& stream);
/// The same of positions in axes `pitch` apart, where what is no particle neither moves nor is infinite.
template <class Real>
void look_at_axes(const Real* now, const Real* before, const Real* increment, std::size_t pitch,
                  std::size_t count, const Look& look, Fault* fault, const Stream& stream);

}  // namespace voxspring::cuda
