// Finds the blocks of a launch that have particles of a border. These blocks are stepped before the others.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "backends/layout/blocks.h"

namespace voxspring::layout {

/// The two parts of a step whose border is stepped first.
enum class StepPart : std::uint8_t { border, interior };

/// Blocks in two parts: first those with a particle of a border, then all others.
template <class Block>
struct BlockParts {
    std::vector<Block> blocks;
    std::size_t border = 0;  ///< number of blocks in the first part

    std::size_t begin_of(StepPart part) const { return part == StepPart::border ? 0 : border; }
    std::size_t count_of(StepPart part) const {
        return part == StepPart::border ? border : blocks.size() - border;
    }
};

/// The blocks of list_blocks() in two parts. `border`: the border's particles.
BlockParts<BlockOrigin> part_blocks(const Lattice& lattice, BlockShape shape,
                                    const std::vector<std::uint32_t>& border);
/// The numbers of blocks in two parts, if `particles` particles are divided in canonical order into blocks of
/// `block` particles. `border`: the border's particles.
BlockParts<std::uint32_t> part_blocks(std::size_t particles, unsigned block,
                                      const std::vector<std::uint32_t>& border);

}  // namespace voxspring::layout
