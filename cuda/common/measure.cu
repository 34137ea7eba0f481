#include "cuda/common/measure.h"
#include "cuda/kernels/edit.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

template <class Real>
__global__ void measure(Real* lengths, std::size_t count) {
    const std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) lengths[i] = measured_or_zero(lengths[i]);
}

template <class Real>
__global__ void measure(SpringConstants<Real>* springs, std::size_t count) {
    const std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) springs[i].rest_length = measured_or_zero(springs[i].rest_length);
}

template <class Real>
__global__ void measure_inverse(Real* squared, std::size_t count) {
    const std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) squared[i] = inverse_root(squared[i]);
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
void calibrate_rest_lengths(std::span<Real> squared, const Stream& stream) {
    Buffer<Real> lengths;
    lengths.upload(squared, stream);
    launch(lengths.data(), lengths.size(), stream);
    lengths.download(squared, stream);
}

template <class Real>
void measure_inverse_roots(std::span<Real> squared, const Stream& stream) {
    Buffer<Real> values;
    values.upload(squared, stream);
    measure_inverse<<<unsigned((values.size() + block - 1) / block), block, 0, stream.get()>>>(values.data(),
                                                                                               values.size());
    check(cudaGetLastError());
    values.download(squared, stream);
}

template <class Real>
void calibrate_rest_lengths(const Buffer<SpringConstants<Real>>& springs, const Stream& stream) {
    launch(springs.data(), springs.size(), stream);
}

template void calibrate_rest_lengths(std::span<float>, const Stream&);
template void calibrate_rest_lengths(std::span<double>, const Stream&);
template void measure_inverse_roots(std::span<float>, const Stream&);
template void measure_inverse_roots(std::span<double>, const Stream&);
template void calibrate_rest_lengths(const Buffer<SpringConstants<float>>&, const Stream&);
template void calibrate_rest_lengths(const Buffer<SpringConstants<double>>&, const Stream&);

}  // namespace voxspring::cuda
