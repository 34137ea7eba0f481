// A Vulkan device without a window system.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/glsl/device.h"
#include "backends/vulkan/api.h"
#include "backends/vulkan/messages.h"

namespace voxspring::vulkan {

using glsl::BufferLimits;

/// Types of memory in which to try to allocate `bytes` bytes, in this order: the types among `allowed` that
/// have `wanted` and `preferred`, then those that have only `wanted`. `preferred` does not count if `bytes`
/// is a large share of the heap: the part of a card's memory that the host sees is often only 256 MiB, and
/// other programs need it too.
std::vector<std::uint32_t> memory_types(const vk::PhysicalDeviceMemoryProperties& memory,
                                        std::uint32_t allowed, vk::MemoryPropertyFlags wanted,
                                        vk::MemoryPropertyFlags preferred, std::uint64_t bytes);

/// A logical device with one queue. Several may exist in one process.
class Device {
public:
    /// Opens the first usable physical device among those that asked_device("vulkan") names, in the order of
    /// devices_to_try(). If the user named none, hardware must be the card that this process measures
    /// (api.h). Throws Unavailable, which says why no device is taken.
    explicit Device(Precision precision);
    Device(const Device&) = delete;
    Device& operator=(const Device&) = delete;

    const vk::raii::Device& get() const { return device_; }
    const vk::raii::PhysicalDevice& physical() const { return physical_; }
    std::uint32_t queue_family() const { return queue_family_; }

    /// Throws DeviceError if a validation layer has complained since the last call (messages.h).
    void check(const std::string& doing) const { messages_->check(doing); }

    /// Whether VK_LAYER_KHRONOS_validation is active.
    bool validates() const { return validates_; }

    const Capabilities& capabilities() const { return capabilities_; }
    const vk::PhysicalDeviceProperties& properties() const { return properties_; }
    const vk::PhysicalDeviceLimits& limits() const { return properties_.limits; }
    const BufferLimits& buffer_limits() const { return buffer_limits_; }
    /// Bytes that this process may still take from the device's memory, in the heap that has most: the number
    /// that the driver gives (VK_EXT_memory_budget), or else the size of the heap.
    std::uint64_t free_memory_bytes() const;
    bool has_pipeline_statistics() const { return has_pipeline_statistics_; }
    bool has_float64() const { return has_float64_; }

private:
    void take(vk::raii::PhysicalDevice physical);
    void create_device();

    std::unique_ptr<Messages> messages_;  // outlives the instance that reports to it
    vk::raii::Context loader_;
    vk::raii::Instance instance_{nullptr};
    vk::raii::DebugUtilsMessengerEXT messenger_{nullptr};
    vk::raii::PhysicalDevice physical_{nullptr};
    vk::raii::Device device_{nullptr};
    std::uint32_t queue_family_ = 0;
    Capabilities capabilities_;
    vk::PhysicalDeviceProperties properties_;
    BufferLimits buffer_limits_;
    bool validates_ = false;
    bool has_budget_ = false;
    bool has_pipeline_statistics_ = false;
    bool has_float64_ = false;
};

}  // namespace voxspring::vulkan
