// What a Vulkan device can do at best.
#pragma once

#include "backends/limits.h"
#include "backends/vulkan/queue.h"

namespace voxspring::vulkan {

/// In dispatches, a barrier after each, that a VulkanBackend steps by. Nothing else is enqueued.
DeviceLimits measure_limits(Queue& queue);

}  // namespace voxspring::vulkan
