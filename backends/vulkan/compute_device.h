// Vulkan as a device of the shared host of compute shaders (glsl/compute_backend.h): steps are recorded once
// and replayed (README.md).
#pragma once

#include <memory>

#include "backends/glsl/device.h"
#include "backends/vulkan/queue.h"

namespace voxspring::vulkan {

/// Throws Unavailable.
std::unique_ptr<glsl::Device> make_compute_device(const Options& options);

/// Vulkan's own device of a backend of this folder.
const Device& device_of(Backend& backend);

/// The buffer of an array that such a device made.
const Buffer& buffer_of(const glsl::Array& array);

/// A vertical list in arrays of at most `max_bytes` bytes each. `values`: those of all slots, which have the
/// same size, at most `max_bytes`; may be empty. The list must outlive what is enqueued.
glsl::AddressedList addressed_list(Queue& queue, std::span<const std::byte> values, std::size_t slots,
                                   std::uint64_t max_bytes);

}  // namespace voxspring::vulkan
