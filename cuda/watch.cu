#include <algorithm>

#include "cuda/watch.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

template <class Real>
__global__ void look_kernel(const Word<Real>* words, const Word<Real>* before, const Real* increment,
                            std::size_t pitch, std::size_t count, Real most_squared, Look look,
                            Fault* first) {
    bool fault = false;
    for (std::size_t i = std::size_t(blockIdx.x) * block + threadIdx.x; i < count;
         i += std::size_t(gridDim.x) * block) {
        const Particle<Real> self = load_past_l1(words + i);
        if (self.bits == 0) continue;
        const Vector<Real> v =
            before != nullptr ? self.position - load_past_l1(before + i).position
                              : Vector<Real>{increment[i], increment[pitch + i], increment[2 * pitch + i]};
        // Not "greater than": a NaN is at fault.
        if (!(v.x * v.x + v.y * v.y + v.z * v.z <= most_squared) ||
            !isfinite(self.position.x + self.position.y + self.position.z))
            fault = true;
    }
    if (__syncthreads_or(int(fault)) != 0 && threadIdx.x == 0) {
        atomicMin(&first->step, static_cast<long long>(look.step));
        atomicMin(&first->last, static_cast<long long>(look.last));
    }
}

}  // namespace

template <class Real>
void look_at(const Word<Real>* words, const Word<Real>* before, const Real* increment, std::size_t pitch,
             std::size_t count, const Look& look, Fault* fault, const Stream& stream) {
    if (count == 0) return;
    // Few enough that an atomic of each costs nothing.
    constexpr std::size_t most_blocks = 1024;
    const auto blocks = unsigned(std::min(most_blocks, (count + block - 1) / block));
    look_kernel<<<blocks, block, 0, stream.get()>>>(words, before, increment, pitch, count,
                                                    Real(look.largest_increment * look.largest_increment),
                                                    look, fault);
    check(cudaGetLastError());
}

template void look_at(const Word<float>*, const Word<float>*, const float*, std::size_t, std::size_t,
                      const Look&, Fault*, const Stream&);
template void look_at(const Word<double>*, const Word<double>*, const double*, std::size_t, std::size_t,
                      const Look&, Fault*, const Stream&);

}  // namespace voxspring::cuda
