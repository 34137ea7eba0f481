// What the GPU can do at best.
#pragma once

#include "backends/limits.h"
#include "cuda/device/device.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// Measures `device`, which is current, by kernels enqueued in `stream`. Waits for them.
DeviceLimits measure_limits(const Device& device, const Stream& stream);

}  // namespace voxspring::cuda
