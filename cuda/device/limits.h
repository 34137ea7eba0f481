// What the GPU can do at best.
#pragma once

#include "backends/limits.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// Of the current device, in kernels enqueued in `stream`. Waits for them.
DeviceLimits measure_limits(const Stream& stream);

}  // namespace voxspring::cuda
