// Measures what a Vulkan device can do at best.
#pragma once

#include "backends/limits.h"
#include "backends/vulkan/queue.h"

namespace voxspring::vulkan {

/// Measures dispatches with a barrier after each, as a VulkanBackend steps. Nothing else may be enqueued.
DeviceLimits measure_limits(Queue& queue);

}  // namespace voxspring::vulkan
