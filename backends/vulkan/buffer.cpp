#include "backends/vulkan/buffer.h"

namespace voxspring::vulkan {

Buffer::Buffer(const Device& device, std::size_t bytes, Place place) : bytes_(bytes) {
    if (bytes == 0) return;
    using Usage = vk::BufferUsageFlagBits;
    using Memory = vk::MemoryPropertyFlagBits;
    buffer_ = {device.get(), vk::BufferCreateInfo({}, bytes,
                                                  Usage::eStorageBuffer | Usage::eUniformBuffer |
                                                      Usage::eTransferSrc | Usage::eTransferDst)};
    const vk::MemoryRequirements needs = buffer_.getMemoryRequirements();
    const bool on_host = place != Place::device;
    const std::uint32_t type =
        on_host ? device.memory_type(needs.memoryTypeBits, Memory::eHostVisible | Memory::eHostCoherent,
                                     place == Place::host ? Memory::eDeviceLocal : Memory::eHostCached)
                : device.memory_type(needs.memoryTypeBits, Memory::eDeviceLocal);
    memory_ = {device.get(), vk::MemoryAllocateInfo(needs.size, type)};
    buffer_.bindMemory(*memory_, 0);
    if (on_host) host_ = static_cast<std::byte*>(memory_.mapMemory(0, VK_WHOLE_SIZE));
}

}  // namespace voxspring::vulkan
