// The body of the kernel of a feed (backends/facets.h), which writes the displacements of some particles.
#pragma once

#include "backends/layout/records/feed.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {

/// A displacement as the readers of feeds expect it: 16 bytes, the last four of which are 0.
struct alignas(16) FedDisplacement {
    Vector<float> displacement;
    float zero;
};

template <class Real>
struct Feeding {
    const FedWord<Real>* fed;
    std::size_t count;
    const ParticleRecord<Real>* words;
    const ParticleRecord<Real>* words_low;  ///< null: there are no low parts
};

template <class Real>
VOXSPRING_HOST_DEVICE FedDisplacement fed_displacement(const Feeding<Real>& feeding, std::size_t n) {
    const FedWord<Real> fed = feeding.fed[n];
    Vector<Real> moved = load_past_l1(feeding.words + fed.word).position - fed.rest;
    if (feeding.words_low != nullptr) moved = moved + load_past_l1(feeding.words_low + fed.word).position;
    return {{float(moved.x), float(moved.y), float(moved.z)}, 0};
}

}  // namespace voxspring::cuda
