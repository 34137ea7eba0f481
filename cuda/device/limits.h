// Measures a GPU's limits: bandwidths, arithmetic rates, and the times of a launch, a barrier and an
// exchange.
#pragma once

#include "backends/limits.h"
#include "cuda/device/device.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// Measures the limits of `device`, which must be current, by kernels in `stream`. Waits for these.
DeviceLimits measure_limits(const Device& device, const Stream& stream);

}  // namespace voxspring::cuda
