// Which parts of the grid are at rest, so that cpu_parallel need not step them.
//
// The next state of a tile depends only on its state and on that of the tiles around it. If no bit of these
// changed in the latest step, the next step would change none either, so the tile rests: it is not stepped.
// By a similar rule a tile falls asleep: if it and the tiles around it moved slowly for `window` steps.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

namespace voxspring::cpu_parallel {

/// Tiles of 1 x 4 x 4 blocks along x, y and z. Steps are numbered from 1; step n leads to state n.
class Tiles {
public:
    /// What one thread knows about the tiles that its blocks touch.
    struct Share {
        std::size_t begin = 0, end = 0;    ///< the tiles' indices are in [begin, end)
        std::vector<std::uint8_t> action;  ///< TileAction by tile, for the current step
        std::vector<std::uint8_t> active;  ///< by tile: whether the step left it active
        std::array<std::vector<std::uint8_t>, 3> marks;
    };

    /// `blocks`: the blocks per row, rows and slices of the grid. If `window` is 1, tiles rest. Otherwise a
    /// tile falls asleep, and loses its speed, once it and the tiles around it were not active for `window`
    /// steps.
    Tiles(glm::ivec3 blocks, int window);

    /// Index of the tile that contains the block.
    std::uint32_t at(glm::ivec3 block) const {
        return std::uint32_t(2 * shape_.margin + block.x + (block.y / side) * shape_.row +
                             (block.z / side) * shape_.plane);
    }
    /// Notes that the tile has blocks to step.
    void use(std::uint32_t tile) { used_[tile] = 1; }
    std::size_t used() const;
    /// Bytes of a Tiles object and `shares` shares.
    static std::size_t bytes(glm::ivec3 blocks, std::size_t shares);

    /// A share for a thread whose blocks lie in the tiles [begin, end).
    Share share(std::size_t begin, std::size_t end) const;

    /// Notes that one tile, or every tile in use, counts as active in step `step`.
    void mark_active(std::uint32_t tile, std::int64_t step) { latest_[std::size_t(step % 2)][tile] = step; }
    void mark_all_active(std::int64_t step);

    /// Decides what step `step` does with each tile of the share (Share::action). All threads must have
    /// finished the step before.
    void decide(Share& share, std::int64_t step) const;
    /// Records after step `step` which tiles of the share are active, and clears Share::active. A tile may be
    /// in several shares.
    void settle(Share& share, std::int64_t step);

    /// How many tiles of the shares were stepped in their latest step.
    std::size_t stepped(const std::vector<const Share*>& shares) const;

private:
    static constexpr int side = 4;

    struct Shape {
        explicit Shape(glm::ivec3 blocks);

        /// Distances between tiles along y and z. A tile of padding ends each row, and a row of padding each
        /// plane, so the last tile of a row does not touch the next row.
        std::ptrdiff_t row, plane;
        /// Distance from a tile's index to that of its farthest neighbour. 2 * margin unused tiles lie before
        /// the first tile and after the last.
        std::ptrdiff_t margin;
        std::ptrdiff_t count;
    };

    const int window_;
    const Shape shape_;
    std::vector<std::uint8_t> used_;
    /// The latest step in which each tile was active, as known after even steps and after odd steps: one of
    /// the two is read while the other is written.
    std::array<std::vector<std::int64_t>, 2> latest_;
};

}  // namespace voxspring::cpu_parallel
