// Arrays in memory that shaders read and write.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "backends/vulkan/device.h"

namespace voxspring::vulkan {

enum class Place : std::uint8_t {
    device,  ///< the device's own memory
    /// The device's own memory, which shaders may also reach by its address (BufferLimits::has_addresses).
    addressed,
    /// Memory that the host writes and shaders read once. The device's own is preferred (memory_types()).
    host,
    staging  ///< memory that the host reads and writes fast, for copies
};

/// An array of a fixed size.
class Buffer {
public:
    Buffer() = default;
    /// If `bytes` is 0, no Vulkan buffer is made.
    Buffer(const Device& device, std::size_t bytes, Place place);

    vk::Buffer get() const { return *buffer_; }
    std::size_t bytes() const { return bytes_; }
    /// The address at which shaders reach the buffer, if its place is `addressed`.
    vk::DeviceAddress address() const { return address_; }
    /// The buffer's memory as the host sees it; the device sees what the host writes at once. Only for
    /// Place::host and Place::staging.
    std::span<std::byte> host() const { return {host_, bytes_}; }

private:
    vk::raii::DeviceMemory memory_{nullptr};  // outlives the buffer
    vk::raii::Buffer buffer_{nullptr};
    std::size_t bytes_ = 0;
    vk::DeviceAddress address_ = 0;
    std::byte* host_ = nullptr;
};

/// Keeps buffers for data that the host hands over once (Place::host), and uses them again. An edit needs
/// some small buffers, and a driver takes longer to allocate memory than a device takes to make the edit.
class BufferPool {
public:
    /// `device` must outlive the pool. The pool may be destroyed before the buffers that it returned.
    explicit BufferPool(const Device& device) : device_(device), spare_(std::make_shared<Spare>()) {}

    /// A buffer that begins with `bytes` and that the device can read; an empty buffer if `bytes` is empty.
    /// The buffer may be larger than `bytes`; its further bytes are undefined. The last owner must release it
    /// only after the device has read it. The pool keeps no buffer of more than 1 MiB.
    std::shared_ptr<const Buffer> holding(std::span<const std::byte> bytes);

private:
    std::shared_ptr<Buffer> of_size(std::size_t size);

    /// Spare buffers by size.
    using Spare = std::map<std::size_t, std::vector<std::unique_ptr<Buffer>>>;

    const Device& device_;
    std::shared_ptr<Spare> spare_;
};

}  // namespace voxspring::vulkan
