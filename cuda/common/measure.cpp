#include "cuda/common/measure.h"

#include "cuda/common/support_kernels.h"

namespace voxspring::cuda {

template <class Real>
void calibrate_rest_lengths(std::span<Real> squared, const Stream& stream) {
    Buffer<Real> lengths;
    lengths.upload(squared, stream);
    launch_for_each(*support_kernels<Real>().measure_lengths, lengths.size(), stream, lengths.data(),
                    lengths.size());
    lengths.download(squared, stream);
}

template <class Real>
void measure_inverse_roots(std::span<Real> squared, const Stream& stream) {
    Buffer<Real> values;
    values.upload(squared, stream);
    launch_for_each(*support_kernels<Real>().measure_inverse_roots, values.size(), stream, values.data(),
                    values.size());
    values.download(squared, stream);
}

template <class Real>
void calibrate_rest_lengths(const Buffer<SpringConstants<Real>>& springs, const Stream& stream) {
    launch_for_each(*support_kernels<Real>().measure_springs, springs.size(), stream, springs.data(),
                    springs.size());
    stream.synchronize();
}

template void calibrate_rest_lengths(std::span<float>, const Stream&);
template void calibrate_rest_lengths(std::span<double>, const Stream&);
template void measure_inverse_roots(std::span<float>, const Stream&);
template void measure_inverse_roots(std::span<double>, const Stream&);
template void calibrate_rest_lengths(const Buffer<SpringConstants<float>>&, const Stream&);
template void calibrate_rest_lengths(const Buffer<SpringConstants<double>>&, const Stream&);

}  // namespace voxspring::cuda
