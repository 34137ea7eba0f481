// Turns the messages of validation layers into DeviceError.
#pragma once

#include <mutex>
#include <string>

#include "backends/vulkan/api.h"

namespace voxspring::vulkan {

/// Collects the messages of one instance. A driver may call back from one of its threads.
class Messages {
public:
    Messages() = default;
    Messages(const Messages&) = delete;
    Messages& operator=(const Messages&) = delete;
    /// A message that no check() has reported goes to stderr and is counted (validation.h).
    ~Messages();

    /// Throws DeviceError if there was a message since the last call. `doing` says what was going on.
    void check(const std::string& doing);

    /// Describes a messenger that sends warnings and errors of an instance to this object.
    vk::DebugUtilsMessengerCreateInfoEXT messenger();

private:
    static VKAPI_ATTR VkBool32 VKAPI_CALL receive(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                                  VkDebugUtilsMessageTypeFlagsEXT types,
                                                  const VkDebugUtilsMessengerCallbackDataEXT* data,
                                                  void* messages);

    std::mutex mutex_;
    std::string first_;  ///< the first message since the last check; later ones follow from it
};

}  // namespace voxspring::vulkan
