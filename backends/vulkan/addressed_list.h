// Neighbour lists larger than a storage buffer: shaders reach them by the addresses of their slots
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

/// Whether lists of a problem go by the addresses of their slots: where a storage buffer does not hold one of
/// them, or where the tuning asks for it (`lists`).
bool by_address(const Problem& problem, const Options& options, const BufferLimits& limits);

/// Empty, or why a device cannot hold the lists of a problem.
std::string lists_refusal(const Problem& problem, const Options& options, const BufferLimits& limits);

/// A vertical list in as many arrays as it takes.
class AddressedList {
public:
    AddressedList() = default;
    /// `values`: those of all slots, which are of one size, no larger than `max_bytes`; may be empty. The
    /// list outlives what is enqueued.
    AddressedList(Queue& queue, std::span<const std::byte> values, std::size_t slots,
                  std::uint64_t max_bytes);

    /// Where each slot lies, for the shader to read.
    const std::vector<vk::DeviceAddress>& addresses() const { return addresses_; }
    /// Arrays of whole slots, in order, none larger than `max_bytes`; storage buffers too.
    std::span<const Buffer> parts() const { return parts_; }

private:
    std::vector<Buffer> parts_;
    std::vector<vk::DeviceAddress> addresses_;
};

}  // namespace voxspring::vulkan
