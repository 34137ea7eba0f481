#include "backends/vulkan/buffer.h"

namespace voxspring::vulkan {

Buffer::Buffer(const Device& device, std::size_t bytes, Place place) : bytes_(bytes) {
    if (bytes == 0) return;
    using Usage = vk::BufferUsageFlagBits;
    using Memory = vk::MemoryPropertyFlagBits;
    const bool addressed = place == Place::addressed;
    auto usage = Usage::eStorageBuffer | Usage::eUniformBuffer | Usage::eTransferSrc | Usage::eTransferDst;
    if (addressed) usage |= Usage::eShaderDeviceAddress;
    buffer_ = {device.get(), vk::BufferCreateInfo({}, bytes, usage)};
    const vk::MemoryRequirements needs = buffer_.getMemoryRequirements();
    const bool on_host = place == Place::host || place == Place::staging;
    const std::uint32_t type =
        on_host ? device.memory_type(needs.memoryTypeBits, Memory::eHostVisible | Memory::eHostCoherent,
                                     place == Place::host ? Memory::eDeviceLocal : Memory::eHostCached)
                : device.memory_type(needs.memoryTypeBits, Memory::eDeviceLocal);
    const vk::MemoryAllocateFlagsInfo by_address(vk::MemoryAllocateFlagBits::eDeviceAddress);
    memory_ = {device.get(), vk::MemoryAllocateInfo(needs.size, type, addressed ? &by_address : nullptr)};
    buffer_.bindMemory(*memory_, 0);
    if (addressed) address_ = device.get().getBufferAddress(vk::BufferDeviceAddressInfo(*buffer_));
    if (on_host) host_ = static_cast<std::byte*>(memory_.mapMemory(0, VK_WHOLE_SIZE));
}

}  // namespace voxspring::vulkan
