// The hash of a device's state (physics/state_hash.h) on the host: several sums.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "backends/physics/state_hash.h"

namespace voxspring::layout {

using HashSums = std::array<std::uint32_t, STATE_HASH_SUMS>;

/// The sums as decimal numbers, each followed by a space.
inline std::string text_of(const HashSums& sums) {
    std::string text;
    for (const std::uint32_t sum : sums) text += std::to_string(sum) + " ";
    return text;
}

}  // namespace voxspring::layout
