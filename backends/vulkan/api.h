// Vulkan-Hpp as this folder includes it: no function is linked, and the loader is opened when a device
// or the list of devices is asked for.
#pragma once

#define VK_NO_PROTOTYPES
#define VULKAN_HPP_ENABLE_DYNAMIC_LOADER_TOOL 0

#include <string>
#include <utility>
#include <vulkan/vulkan_raii.hpp>

#include "backends/backend.h"

namespace voxspring::vulkan {

/// Returns the result of `work`. If Vulkan fails in `work`, throws a DeviceError that names `doing`.
template <class Work>
decltype(auto) guarded(const char* doing, Work&& work) {
    try {
        return std::forward<Work>(work)();
    } catch (const vk::SystemError& error) {
        throw DeviceError(std::string(error.what()) + " (while " + doing + ")");
    }
}

}  // namespace voxspring::vulkan
