// Whether validation layers are active, and how many of their messages became no error.
#pragma once

namespace voxspring::vulkan {

/// Whether VOXSPRING_VULKAN_VALIDATION is set and not empty, which asks for VK_LAYER_KHRONOS_validation. If
/// that layer is installed, its messages become DeviceErrors of the backend (messages.h).
bool wants_validation();

/// How many messages in this process became no error, because no check followed them, such as one about
/// objects that were never destroyed. They are on stderr.
int unreported_messages();

}  // namespace voxspring::vulkan
