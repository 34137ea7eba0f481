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
    device,     ///< the device's own memory
    addressed,  ///< the same, which shaders may reach by its address (BufferLimits::has_addresses)
    host,       ///< what the host writes and shaders read once: the device's own where the host sees that
    staging     ///< memory that the host reads and writes fast, for copies
};

/// An array of a fixed size.
class Buffer {
public:
    Buffer() = default;
    /// Of no bytes: no buffer at all.
    Buffer(const Device& device, std::size_t bytes, Place place);

    vk::Buffer get() const { return *buffer_; }
    std::size_t bytes() const { return bytes_; }
    /// Where shaders reach it that is `addressed`.
    vk::DeviceAddress address() const { return address_; }
    /// But on the device: what the device sees at once.
    std::span<std::byte> host() const { return {host_, bytes_}; }

private:
    vk::raii::DeviceMemory memory_{nullptr};  // outlives the buffer
    vk::raii::Buffer buffer_{nullptr};
    std::size_t bytes_ = 0;
    vk::DeviceAddress address_ = 0;
    std::byte* host_ = nullptr;
};

/// Buffers for what the host hands over once (Place::host), used again and again: an edit needs some small
/// ones, and a driver takes longer to allocate memory than a device to make the edit.
class BufferPool {
public:
    /// `device` must outlive the pool; the pool may go before what it gave.
    explicit BufferPool(const Device& device) : device_(device), spare_(std::make_shared<Spare>()) {}

    /// Bytes where the device reads them; of none, a buffer of none. The last owner lets go once the device
    /// has read them. Room beyond them, up to a power of two, has anything. More than 1 MiB is not kept.
    std::shared_ptr<const Buffer> holding(std::span<const std::byte> bytes);

private:
    std::shared_ptr<Buffer> of_size(std::size_t size);

    /// By size.
    using Spare = std::map<std::size_t, std::vector<std::unique_ptr<Buffer>>>;

    const Device& device_;
    std::shared_ptr<Spare> spare_;
};

}  // namespace voxspring::vulkan
