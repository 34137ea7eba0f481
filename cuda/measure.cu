#include <cfloat>

#include "backends/physics/inverse_root.h"
#include "cuda/measure.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

// An unused slot of a list has no length. inverse_root() is for normal numbers.
template <class Real>
__device__ Real measured(Real squared) {
    constexpr Real smallest = sizeof(Real) == sizeof(float) ? Real(FLT_MIN) : Real(DBL_MIN);
    return squared >= smallest ? measured_length(squared) : Real(0);
}

template <class Real>
__global__ void measure(Real* lengths, std::size_t count) {
    const std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) lengths[i] = measured(lengths[i]);
}

template <class Real>
__global__ void measure(SpringConstants<Real>* springs, std::size_t count) {
    const std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) springs[i].rest_length = measured(springs[i].rest_length);
}

template <class T>
void launch(T* values, std::size_t count, const Stream& stream) {
    if (count == 0) return;
    measure<<<unsigned((count + block - 1) / block), block, 0, stream.get()>>>(values, count);
    check(cudaGetLastError());
    stream.synchronize();
}

}  // namespace

template <class Real>
void measure_rest_lengths(std::span<Real> squared, const Stream& stream) {
    Buffer<Real> lengths;
    lengths.upload(squared, stream);
    launch(lengths.data(), lengths.size(), stream);
    lengths.download(squared, stream);
}

template <class Real>
void measure_rest_lengths(const Buffer<SpringConstants<Real>>& springs, const Stream& stream) {
    launch(springs.data(), springs.size(), stream);
}

template void measure_rest_lengths(std::span<float>, const Stream&);
template void measure_rest_lengths(std::span<double>, const Stream&);
template void measure_rest_lengths(const Buffer<SpringConstants<float>>&, const Stream&);
template void measure_rest_lengths(const Buffer<SpringConstants<double>>&, const Stream&);

}  // namespace voxspring::cuda
