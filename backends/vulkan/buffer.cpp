#include "backends/vulkan/buffer.h"

#include <algorithm>
#include <bit>
#include <utility>

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
    const vk::MemoryPropertyFlags wanted = on_host ? Memory::eHostVisible | Memory::eHostCoherent
                                                   : vk::MemoryPropertyFlags(Memory::eDeviceLocal);
    const vk::MemoryPropertyFlags preferred = place == Place::host      ? Memory::eDeviceLocal
                                              : place == Place::staging ? Memory::eHostCached
                                                                        : vk::MemoryPropertyFlags();
    const auto types = memory_types(device.physical().getMemoryProperties(), needs.memoryTypeBits, wanted,
                                    preferred, needs.size);
    if (types.empty()) throw DeviceError("the device has no type of memory that is " + vk::to_string(wanted));
    const vk::MemoryAllocateFlagsInfo by_address(vk::MemoryAllocateFlagBits::eDeviceAddress);
    for (std::size_t n = 0; n < types.size(); ++n) {
        try {
            memory_ = {device.get(),
                       vk::MemoryAllocateInfo(needs.size, types[n], addressed ? &by_address : nullptr)};
            break;
        } catch (const vk::SystemError&) {
            if (n + 1 == types.size()) throw;  // otherwise try the next type: another heap may have room
        }
    }
    buffer_.bindMemory(*memory_, 0);
    if (addressed) address_ = device.get().getBufferAddress(vk::BufferDeviceAddressInfo(*buffer_));
    if (on_host) host_ = static_cast<std::byte*>(memory_.mapMemory(0, VK_WHOLE_SIZE));
}

std::shared_ptr<const Buffer> BufferPool::holding(std::span<const std::byte> bytes) {
    constexpr std::size_t least = 256, largest_kept = std::size_t(1) << 20;
    if (bytes.empty()) return std::make_shared<Buffer>();
    std::shared_ptr<Buffer> buffer;
    if (bytes.size() > largest_kept) {
        buffer = std::make_shared<Buffer>(device_, bytes.size(), Place::host);
    } else {
        buffer = of_size(std::bit_ceil(std::max(bytes.size(), least)));
    }
    std::ranges::copy(bytes, buffer->host().begin());
    return buffer;
}

std::shared_ptr<Buffer> BufferPool::of_size(std::size_t size) {
    std::vector<std::unique_ptr<Buffer>>& spare = (*spare_)[size];
    if (spare.empty()) spare.push_back(std::make_unique<Buffer>(device_, size, Place::host));
    Buffer* const taken = spare.back().release();
    spare.pop_back();
    return {taken, [pool = std::weak_ptr(spare_)](Buffer* given) {
                std::unique_ptr<Buffer> back(given);
                if (const auto known = pool.lock()) (*known)[back->bytes()].push_back(std::move(back));
            }};
}

}  // namespace voxspring::vulkan
