#include "harness/volume/readers.h"

#include <algorithm>
#include <bit>
#include <cstddef>

namespace voxspring {

std::optional<std::array<std::size_t, 3>> axes_of_space(const std::vector<std::int64_t>& sizes,
                                                        const std::vector<bool>& is_of_space) {
    std::vector<std::size_t> kept;
    for (std::size_t axis = 0; axis < sizes.size(); ++axis) kept.push_back(axis);
    const auto drop_one = [&](auto begin, auto end, const auto& may_go) {
        const auto found = std::find_if(begin, end, may_go);
        if (found == end) return false;
        kept.erase(kept.begin() + (&*found - kept.data()));
        return true;
    };
    const auto is_one = [&](std::size_t axis) { return sizes[axis] == 1; };
    const auto is_one_beside_space = [&](std::size_t axis) {
        return is_one(axis) && !is_of_space.empty() && !is_of_space[axis];
    };
    while (kept.size() > 3) {
        if (drop_one(kept.begin(), kept.end(), is_one_beside_space)) continue;
        if (drop_one(kept.rbegin(), kept.rbegin() + 1, is_one)) continue;
        if (!drop_one(kept.begin(), kept.begin() + 1, is_one)) return std::nullopt;
    }
    if (kept.size() < 3) return std::nullopt;
    return std::array{kept[0], kept[1], kept[2]};
}

std::string sizes_accepted(int dimensions) {
    return std::to_string(dimensions) +
           " whole numbers, 3 of them sides and all further ones 1: a volume has one value a voxel";
}

bool is_spacing(double distance) { return distance >= min_quantity && distance <= max_quantity; }

void to_native_order(std::vector<std::byte>& data, ScalarType type, bool big_endian) {
    if (big_endian == (std::endian::native == std::endian::big)) return;
    const auto each = std::ptrdiff_t(bytes_of(type));
    for (auto scalar = data.begin(); scalar != data.end(); scalar += each)
        std::reverse(scalar, scalar + each);
}

}  // namespace voxspring
