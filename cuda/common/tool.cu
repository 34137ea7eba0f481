#include "cuda/common/tool.h"
#include "cuda/device/check.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 128;

template <class Real>
__global__ void held_kernel(Holding<Real> holding) {
    const std::size_t n = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (n < holding.count) pull_held(holding, n);
}

}  // namespace

template <class Real>
void pull_held(const Holding<Real>& holding, const Stream& stream) {
    if (holding.count == 0) return;
    const auto blocks = unsigned((holding.count + block - 1) / block);
    held_kernel<<<blocks, block, 0, stream.get()>>>(holding);
    check(cudaGetLastError());
}

template void pull_held(const Holding<float>&, const Stream&);
template void pull_held(const Holding<double>&, const Stream&);

}  // namespace voxspring::cuda
