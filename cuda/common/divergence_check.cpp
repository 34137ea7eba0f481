#include "cuda/common/divergence_check.h"

#include <algorithm>

#include "cuda/common/support_kernels.h"

namespace voxspring::cuda {
namespace {

template <class Real, class Particles>
void enqueue(const Kernel& kernel, const Particles& particles, std::size_t count,
             const DivergenceCheck& parameters, FirstDivergence* first, const Stream& stream) {
    if (count == 0) return;
    // So few blocks that one atomic operation of each costs nothing.
    constexpr std::size_t block = 256, max_blocks = 1024;
    const auto blocks = unsigned(std::min(max_blocks, (count + block - 1) / block));
    const auto max_squared = Real(parameters.largest_increment * parameters.largest_increment);
    const auto step = static_cast<long long>(parameters.step);
    const auto last_check = static_cast<long long>(parameters.last_check);
    kernel.launch(stream, dim3(blocks), dim3(unsigned(block)), 0, particles, count, max_squared, step,
                  last_check, first);
}

}  // namespace

template <class Real>
void launch_divergence_check(const ParticleRecord<Real>* words, const ParticleRecord<Real>* before,
                             const Real* increment, std::size_t pitch, std::size_t count,
                             const DivergenceCheck& parameters, FirstDivergence* first,
                             const Stream& stream) {
    enqueue<Real>(*support_kernels<Real>().check_words,
                  ParticlesInWords<Real>{words, before, increment, pitch}, count, parameters, first, stream);
}

template <class Real>
void launch_divergence_check_on_axes(const Real* now, const Real* before, const Real* increment,
                                     std::size_t pitch, std::size_t count, const DivergenceCheck& parameters,
                                     FirstDivergence* first, const Stream& stream) {
    enqueue<Real>(*support_kernels<Real>().check_axes, ParticlesInAxes<Real>{now, before, increment, pitch},
                  count, parameters, first, stream);
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

}  // namespace voxspring::cuda
