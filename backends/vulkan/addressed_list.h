// Neighbour lists that are larger than a storage buffer. Shaders reach them by the addresses of their slots
// (shaders/lists.glsl).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "backends/physics/problem.h"
#include "backends/vulkan/queue.h"

namespace voxspring::vulkan {

/// Whether the lists of a problem are reached by the addresses of their slots: if one of them is too large
/// for a storage buffer, or if the tuning asks for it (`lists`).
bool by_address(const Problem& problem, const Options& options, const BufferLimits& limits);

/// Empty, or why a device cannot hold the lists of a problem.
std::string lists_refusal(const Problem& problem, const Options& options, const BufferLimits& limits);

/// A vertical list in as many arrays as it needs.
class AddressedList {
public:
    AddressedList() = default;
    /// `values`: the values of all slots, which have the same size, at most `max_bytes`; may be empty. The
    /// list must outlive what is enqueued.
    AddressedList(Queue& queue, std::span<const std::byte> values, std::size_t slots,
                  std::uint64_t max_bytes);

    /// The address of each slot, for the shader to read.
    const std::vector<vk::DeviceAddress>& addresses() const { return addresses_; }
    /// The arrays in order, each of whole slots and at most `max_bytes`. They are storage buffers too.
    std::span<const Buffer> parts() const { return parts_; }

private:
    std::vector<Buffer> parts_;
    std::vector<vk::DeviceAddress> addresses_;
};

}  // namespace voxspring::vulkan
