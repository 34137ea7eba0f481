#include <algorithm>

#include "cuda/common/divergence_check.h"
#include "cuda/kernels/motion.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

/// Whether a particle is not finite or moved too far.
template <class Real>
__device__ bool beyond(Vector<Real> position, Vector<Real> v, Real max_squared) {
    // Not "greater than": a NaN has diverged.
    return !(v.x * v.x + v.y * v.y + v.z * v.z <= max_squared) ||
           !isfinite(position.x + position.y + position.z);
}

/// Particles in words. `before` is null by increments, and words without bits are no particles.
template <class Real>
struct InWords {
    const ParticleRecord<Real>* words;
    const ParticleRecord<Real>* before;
    const Real* increment;
    std::size_t pitch;

    __device__ bool has_diverged(std::size_t i, Real max_squared) const {
        const Particle<Real> self = load_past_l1(words + i);
        if (self.bits == 0) return false;
        return beyond(self.position,
                      before != nullptr ? self.position - load_past_l1(before + i).position
                                        : load_axes(increment + i, pitch),
                      max_squared);
    }
};

/// Particles in axes.
template <class Real>
struct InAxes {
    const Real* now;
    const Real* before;
    const Real* increment;
    std::size_t pitch;

    __device__ bool has_diverged(std::size_t i, Real max_squared) const {
        const Vector<Real> position = load_axes(now + i, pitch);
        return beyond(
            position,
            before != nullptr ? position - load_axes(before + i, pitch) : load_axes(increment + i, pitch),
            max_squared);
    }
};

template <class Particles, class Real>
__global__ void divergence_check_kernel(Particles particles, std::size_t count, Real max_squared,
                                        DivergenceCheck parameters, FirstDivergence* first) {
    bool diverged = false;
    for (std::size_t i = std::size_t(blockIdx.x) * block + threadIdx.x; i < count;
         i += std::size_t(gridDim.x) * block)
        diverged = particles.has_diverged(i, max_squared) || diverged;
    if (__syncthreads_or(int(diverged)) != 0 && threadIdx.x == 0) {
        atomicMin(&first->found, static_cast<long long>(parameters.step));
        atomicMin(&first->last_good, static_cast<long long>(parameters.last_check));
    }
}

template <class Real, class Particles>
void enqueue(const Particles& particles, std::size_t count, const DivergenceCheck& parameters,
             FirstDivergence* first, const Stream& stream) {
    if (count == 0) return;
    // Few enough that an atomic of each costs nothing.
    constexpr std::size_t max_blocks = 1024;
    const auto blocks = unsigned(std::min(max_blocks, (count + block - 1) / block));
    divergence_check_kernel<<<blocks, block, 0, stream.get()>>>(
        particles, count, Real(parameters.largest_increment * parameters.largest_increment), parameters,
        first);
    check(cudaGetLastError());
}

}  // namespace

template <class Real>
void launch_divergence_check(const ParticleRecord<Real>* words, const ParticleRecord<Real>* before,
                             const Real* increment, std::size_t pitch, std::size_t count,
                             const DivergenceCheck& parameters, FirstDivergence* first,
                             const Stream& stream) {
    enqueue<Real>(InWords<Real>{words, before, increment, pitch}, count, parameters, first, stream);
}

template <class Real>
void launch_divergence_check_on_axes(const Real* now, const Real* before, const Real* increment,
                                     std::size_t pitch, std::size_t count, const DivergenceCheck& parameters,
                                     FirstDivergence* first, const Stream& stream) {
    enqueue<Real>(InAxes<Real>{now, before, increment, pitch}, count, parameters, first, stream);
}

template void launch_divergence_check(const ParticleRecord<float>*, const ParticleRecord<float>*,
                                      const float*, std::size_t, std::size_t, const DivergenceCheck&,
                                      FirstDivergence*, const Stream&);
template void launch_divergence_check(const ParticleRecord<double>*, const ParticleRecord<double>*,
                                      const double*, std::size_t, std::size_t, const DivergenceCheck&,
                                      FirstDivergence*, const Stream&);

template void launch_divergence_check_on_axes(const float*, const float*, const float*, std::size_t,
                                              std::size_t, const DivergenceCheck&, FirstDivergence*,
                                              const Stream&);
template void launch_divergence_check_on_axes(const double*, const double*, const double*, std::size_t,
                                              std::size_t, const DivergenceCheck&, FirstDivergence*,
                                              const Stream&);

void load_divergence_check() {
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, divergence_check_kernel<InWords<float>, float>));
}

}  // namespace voxspring::cuda
