// Rest lengths measured with the device's inverse root (physics/inverse_root.h).
#pragma once

#include <span>

#include "backends/layout/records/springs.h"
#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// Replaces each squared length by what `kernel` computes from it on the device.
template <class Real>
void measure_on_device(const Kernel& kernel, std::span<Real> squared, const Stream& stream) {
    Buffer<Real> values;
    values.upload(squared, stream);
    launch_for_each(kernel, values.size(), stream, values.data(), values.size());
    values.download(squared, stream);
}
/// Replaces each squared length by its measured_length().
template <class Real>
void calibrate_rest_lengths(std::span<Real> squared, const Stream& stream) {
    measure_on_device(*support_kernels<Real>().measure_lengths, squared, stream);
}
/// Replaces the squared rest length of every spring by its measured_length().
template <class Real>
void calibrate_rest_lengths(const Buffer<SpringConstants<Real>>& springs, const Stream& stream) {
    launch_for_each(*support_kernels<Real>().measure_springs, springs.size(), stream, springs.data(),
                    springs.size());
    stream.synchronize();
}

}  // namespace voxspring::cuda
