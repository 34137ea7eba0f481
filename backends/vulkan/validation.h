// Whether validation layers are wanted, and how many of their messages became no error.
#pragma once

namespace voxspring::vulkan {

/// Whether VOXSPRING_VULKAN_VALIDATION is set and not empty, which asks for VK_LAYER_KHRONOS_validation. If
/// that layer is installed, its messages become DeviceErrors of the backend (messages.h).
bool wants_validation();

/// How many instances in this process had a message that became no error, because no check followed it, such
/// as a message about objects that were never destroyed. Each such instance writes its first one to stderr.
int unreported_messages();

}  // namespace voxspring::vulkan
