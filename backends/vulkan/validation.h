// Whether validation layers are active, and how many of their messages became no error.
#pragma once

namespace voxspring::vulkan {

/// Whether this process asks for VK_LAYER_KHRONOS_validation, if it is installed: VOXSPRING_VULKAN_VALIDATION
/// is set and not empty. A message then becomes a DeviceError of the backend (messages.h).
bool wants_validation();

/// Number of messages in this process that became no error, because no check followed them. They are on
/// stderr. An example is a message about objects that were never destroyed.
int unreported_messages();

}  // namespace voxspring::vulkan
