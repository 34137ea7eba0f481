#include "backends/layout/border_blocks.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "backends/layout/rounding.h"

namespace voxspring::layout {
namespace {

/// Puts the blocks for which is_border(block) is true first. Within both parts blocks keep their order.
template <class Block, class IsBorder>
BlockParts<Block> parted(std::vector<Block> blocks, IsBorder is_border) {
    const auto interior = std::stable_partition(blocks.begin(), blocks.end(), is_border);
    const auto border = std::size_t(interior - blocks.begin());
    return {std::move(blocks), border};
}

}  // namespace

BlockParts<BlockOrigin> part_blocks(const Lattice& lattice, BlockShape shape,
                                    const std::vector<std::uint32_t>& border) {
    const BlockGrid grid(lattice, shape);
    std::vector<std::uint8_t> touched(grid.places());
    for (const std::uint32_t i : border) touched[grid.place_of(lattice, lattice.voxel[i])] = 1;
    return parted(list_blocks(lattice, shape),
                  [&](const BlockOrigin& block) { return touched[std::size_t(block.place)] != 0; });
}

BlockParts<std::uint32_t> part_blocks(std::size_t particles, unsigned block,
                                      const std::vector<std::uint32_t>& border) {
    std::vector<std::uint32_t> blocks(units_of(particles, std::size_t(block)));
    std::iota(blocks.begin(), blocks.end(), 0U);
    std::vector<std::uint8_t> touched(blocks.size());
    for (const std::uint32_t i : border) touched[i / block] = 1;
    return parted(std::move(blocks), [&](std::uint32_t number) { return touched[number] != 0; });
}

}  // namespace voxspring::layout
