// Vulkan as a device (glsl/device.h) for the host code that all compute shaders share
// (glsl/compute_backend.h). Steps are recorded once and replayed (README.md).
#pragma once

#include <memory>

#include "backends/glsl/device.h"

namespace voxspring::vulkan {

class Buffer;
class Device;
class Queue;

/// Makes the device. Throws Unavailable if no device is usable.
std::unique_ptr<glsl::Device> make_compute_device(const Options& options);

/// The vulkan::Device of a backend of this folder.
const Device& device_of(Backend& backend);

/// The Vulkan buffer of an array that a device of make_compute_device() made.
const Buffer& buffer_of(const glsl::Array& array);

/// Uploads a list in arrays of at most `max_bytes` bytes each. `values`: the values of all slots, one slot
/// after another, or empty. Every slot has the same size, at most `max_bytes`. The list must outlive the
/// commands that are enqueued here.
glsl::AddressedList addressed_list(Queue& queue, std::span<const std::byte> values, std::size_t slots,
                                   std::uint64_t max_bytes);

}  // namespace voxspring::vulkan
