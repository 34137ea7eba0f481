#include "backends/vulkan/addressed_list.h"

#include <algorithm>

#include "backends/glsl/explicit.h"

namespace voxspring::vulkan {
namespace {

constexpr const char* no_addresses = "the device has no addresses of buffers (bufferDeviceAddress)";

bool asks_for_addresses(const Options& options) { return options.tuning.at("lists") == "addressed"; }

}  // namespace

bool by_address(const Problem& problem, const Options& options, const BufferLimits& limits) {
    const auto lists = glsl::list_bytes(problem, options);
    return asks_for_addresses(options) || std::any_of(lists.begin(), lists.end(), [&](const auto& list) {
               return list.second > limits.max_bytes;
           });
}

std::string lists_refusal(const Problem& problem, const Options& options, const BufferLimits& limits) {
    if (asks_for_addresses(options) && !limits.has_addresses) return no_addresses;
    for (const auto& [list, bytes] : glsl::list_bytes(problem, options)) {
        const std::string why = limits.has_addresses ? limits.too_large(std::string("slots of ") + list,
                                                                        bytes / glsl::list_slots(problem))
                                                     : limits.too_large(list, bytes);
        if (!why.empty()) return limits.has_addresses ? why : why + ", and " + no_addresses;
    }
    return {};
}

AddressedList::AddressedList(Queue& queue, std::span<const std::byte> values, std::size_t slots,
                             std::uint64_t max_bytes) {
    if (values.empty()) return;
    const std::size_t slot = values.size() / slots;
    const std::size_t part = slot * std::min<std::size_t>(slots, max_bytes / slot);
    for (std::size_t at = 0; at < values.size(); at += part) {
        const auto here = values.subspan(at, std::min(part, values.size() - at));
        parts_.emplace_back(queue.device(), here.size(), Place::addressed);
        queue.upload(parts_.back(), here);
        for (std::size_t begin = 0; begin < here.size(); begin += slot)
            addresses_.push_back(parts_.back().address() + begin);
    }
}

}  // namespace voxspring::vulkan
