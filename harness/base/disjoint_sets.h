// Disjoint sets of indices, merged as pairs join them (union-find).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace voxspring {

/// A partition of the indices below `count` into sets. of() returns the smallest index of the set that has
/// `i`, and join() merges the sets of two indices. At first each index is a set by itself.
class DisjointSets {
public:
    explicit DisjointSets(std::size_t count) : parent_(count) {
        std::iota(parent_.begin(), parent_.end(), 0U);
    }

    std::uint32_t of(std::uint32_t i) {
        while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
        return i;
    }
    void join(std::uint32_t i, std::uint32_t j) {
        const std::uint32_t one = of(i), other = of(j);
        parent_[std::max(one, other)] = std::min(one, other);
    }

private:
    std::vector<std::uint32_t> parent_;
};

}  // namespace voxspring
