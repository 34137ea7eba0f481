// Which parts of the grid are at rest, so that cpu_parallel need not step them.
//
// A step depends on the state of a tile and of its neighbours. If neither changed a bit in the latest step,
// the next one would change none either, so the tile need not be stepped. With a window of several steps and
// "slow" in place of "unchanged" the same rule puts tiles to sleep.
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

    /// `blocks`: the blocks per row, rows and slices of the grid. If `window` > 1, a tile sleeps, and loses
    /// its speed, once it and the tiles around it were not active for `window` steps. With 1 it rests.
    Tiles(glm::ivec3 blocks, int window);

    /// Index of the tile that contains the block.
    std::uint32_t at(glm::ivec3 block) const {
        return std::uint32_t(2 * shape_.margin + block.x + (block.y / side) * shape_.row +
                             (block.z / side) * shape_.plane);
    }
    /// Notes that the tile has blocks to step.
    void use(std::uint32_t tile) { used_[tile] = 1; }
    std::size_t used() const;
    /// Bytes of everything here, with `shares` shares.
    static std::size_t bytes(glm::ivec3 blocks, std::size_t shares);

    /// A share for blocks in tiles of [begin, end).
    Share share(std::size_t begin, std::size_t end) const;

    /// Notes that state `step` of one tile, or of all, is new.
    void mark_active(std::uint32_t tile, std::int64_t step) { latest_[std::size_t(step % 2)][tile] = step; }
    void mark_all_active(std::int64_t step);

    /// Fills in `action` for step `step`. All threads must have finished the step before.
    void decide(Share& share, std::int64_t step) const;
    /// Takes over `active` after step `step` and clears it. Threads may share a tile.
    void settle(Share& share, std::int64_t step);

    /// How many tiles of the shares were stepped in their latest step.
    std::size_t stepped(const std::vector<const Share*>& shares) const;

private:
    static constexpr int side = 4;

    struct Shape {
        explicit Shape(glm::ivec3 blocks);

        /// Distances between tiles along y and z. A tile of padding ends each row and plane, so the last tile
        /// of a row does not touch the next row.
        std::ptrdiff_t row, plane;
        std::ptrdiff_t margin;  ///< to the farthest neighbour; twice that many tiles lie before and behind
        std::ptrdiff_t count;
    };

    const int window_;
    const Shape shape_;
    std::vector<std::uint8_t> used_;
    /// The latest active step of each tile, after an even and after an odd step: one is read while the other
    /// is written.
    std::array<std::vector<std::int64_t>, 2> latest_;
};

}  // namespace voxspring::cpu_parallel
