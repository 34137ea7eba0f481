#include "backends/vulkan/messages.h"

#include <atomic>
#include <cstdio>
#include <cstdlib>

#include "backends/vulkan/validation.h"

namespace voxspring::vulkan {
namespace {

std::atomic<int> unreported = 0;

}  // namespace

bool wants_validation() {
    const char* value = std::getenv("VOXSPRING_VULKAN_VALIDATION");
    return value != nullptr && *value != '\0';
}

int unreported_messages() { return unreported; }

Messages::~Messages() {
    if (first_.empty()) return;
    ++unreported;
    (void)std::fprintf(stderr, "Vulkan: %s\n", first_.c_str());
}

void Messages::check(const std::string& doing) {
    const std::lock_guard lock(mutex_);
    if (first_.empty()) return;
    const std::string reason = first_ + " (while " + doing + ")";
    first_.clear();
    throw DeviceError(reason);
}

vk::DebugUtilsMessengerCreateInfoEXT Messages::messenger() {
    using Severity = vk::DebugUtilsMessageSeverityFlagBitsEXT;
    using Type = vk::DebugUtilsMessageTypeFlagBitsEXT;
    return {{}, Severity::eWarning | Severity::eError, Type::eValidation | Type::ePerformance, receive, this};
}

VkBool32 Messages::receive(VkDebugUtilsMessageSeverityFlagBitsEXT, VkDebugUtilsMessageTypeFlagsEXT,
                           const VkDebugUtilsMessengerCallbackDataEXT* data, void* messages) {
    auto* self = static_cast<Messages*>(messages);
    try {
        const std::lock_guard lock(self->mutex_);
        if (self->first_.empty()) self->first_ = data->pMessage;
    } catch (...) {
        // An exception must not pass through the driver.
        ++unreported;
    }
    return VK_FALSE;
}

}  // namespace voxspring::vulkan
