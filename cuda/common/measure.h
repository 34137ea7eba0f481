// Rest lengths measured with the device's inverse root (physics/inverse_root.h).
#pragma once

#include <array>
#include <span>

#include "backends/layout/records/springs.h"
#include "cuda/device/buffer.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// measured_length() of each square, computed on the device.
template <class Real>
void calibrate_rest_lengths(std::span<Real> squared, const Stream& stream);

/// inverse_root() of each square, computed on the device.
template <class Real>
void measure_inverse_roots(std::span<Real> squared, const Stream& stream);

/// Turns the squared rest length of every spring into its length, in place.
template <class Real>
void calibrate_rest_lengths(const Buffer<SpringConstants<Real>>& springs, const Stream& stream);

}  // namespace voxspring::cuda
