// Whether validation layers look on, and what they said that nobody heard.
#pragma once

namespace voxspring::vulkan {

/// Whether this process asks for VK_LAYER_KHRONOS_validation, where it is installed:
/// VOXSPRING_VULKAN_VALIDATION is set and not empty. A message is then a DeviceError of the backend
/// (messages.h).
bool wants_validation();

/// Messages of this process that became no error, because they came last: of what was never destroyed, for
/// example. They are on stderr.
int unreported_messages();

}  // namespace voxspring::vulkan
