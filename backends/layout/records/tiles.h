// The arguments of the tile kernel (cuda/kernels/tiles.h): how tiles of 2 x 2 x 2 voxels lie in memory, and
// the springs of a thread's tile in the order of its mask's bits.
#pragma once

#include "backends/layout/records/brick.h"

namespace voxspring::layout {

inline constexpr int tile_particles = 8;
/// Memory holds tiles in groups. Each group but the first and the last, which are padding, is stepped by one
/// warp, or by two successive warps if a tile has two threads.
inline constexpr std::uint32_t group_tiles = 32;
/// The distance in elements from a particle's x to its y, and from its y to its z. A group stores the x of
/// all its particles, then all y, then all z.
inline constexpr std::size_t tile_axis = std::size_t(tile_particles) * group_tiles;
/// The index of the x of particle `n` of a tile. The n-th particles of all tiles of a group lie side by side,
/// so that the lanes of a warp read consecutive elements.
VOXSPRING_HOST_DEVICE constexpr std::size_t tile_element(std::uint32_t tile, int n) {
    return std::size_t(tile / group_tiles) * (3 * tile_axis) + std::size_t(n) * group_tiles +
           tile % group_tiles;
}
/// Coordinates of particle `n` in its tile, each 0 or 1.
VOXSPRING_HOST_DEVICE constexpr int tile_x(int n) { return n & 1; }
VOXSPRING_HOST_DEVICE constexpr int tile_y(int n) { return n >> 1 & 1; }
VOXSPRING_HOST_DEVICE constexpr int tile_z(int n) { return n >> 2; }

/// The number of rows of tiles around a tile's own row. tile_row(): which of them is at (dy, dz).
inline constexpr std::uint32_t tile_rows = 8;
VOXSPRING_HOST_DEVICE constexpr std::uint32_t tile_row(int dy, int dz) {
    const int row = 3 * (dz + 1) + dy + 1;
    return std::uint32_t(row < 4 ? row : row - 1);
}
/// What a tile T knows of one row of tiles beside it. A tile is active if it has a particle. The record holds
/// the number of the first active tile that comes at the place beside T (dx = 0) or after it in the order of
/// the list, and whether it is at that place. The active tiles of a row have consecutive numbers, so this
/// gives the numbers of the neighbours at dx = -1, 0 and 1. For a row outside of the lattice the record holds
/// the number of a tile of padding.
struct TileRow {
    std::uint32_t entry;

    static VOXSPRING_HOST_DEVICE constexpr TileRow make(std::uint32_t tile, bool beside) {
        return {tile << 1 | (beside ? 1U : 0U)};
    }
    /// The number of the neighbour at `dx` in this row. If that neighbour is not active, the result is the
    /// number of another tile that may be read.
    VOXSPRING_HOST_DEVICE constexpr std::uint32_t at(int dx) const {
        const std::uint32_t tile = entry >> 1;
        return dx < 0 ? tile - 1 : dx == 0 ? tile : tile + (entry & 1U);
    }
    bool operator==(const TileRow&) const = default;
};

/// One bit for each spring of visit_tile_springs(), set if the spring exists; then one bit for each particle
/// of the tile, set if the particle moves.
struct alignas(16) TileMask {
    static constexpr int springs = 120;
    static VOXSPRING_HOST_DEVICE constexpr int moves(int n) { return springs + n; }

    std::uint32_t word[4];  // NOLINT(modernize-avoid-c-arrays)
    /// Not 0 if the bit is set.
    VOXSPRING_HOST_DEVICE constexpr std::uint32_t bit(int number) const {
        return word[number / 32] & 1U << number % 32;
    }
    bool operator==(const TileMask&) const = default;
};

/// Everything that a step needs besides the particles' state. The members `nx` to `words` of the base class
/// are not used.
template <class Real>
struct TileStep : MarchStep<Real> {
    /// The tile_rows entries of each tile; those of one tile are `group_tiles` elements apart.
    const TileRow* rows;
    const TileMask* masks;
    bool operator==(const TileStep&) const = default;
};

/// Visits every spring of a tile, each with its mask bit. visit.both(bit, n, m) is a spring between particles
/// n and m of the tile. visit.point(i, j, k) announces a point of another tile, at coordinates from -1 to 2
/// counted from this tile's first particle. Springs to that point follow: visit.half(bit, n, i, j, k) is its
/// spring to particle n, which the other tile's thread evaluates too. Returns the number of springs.
template <class Visit>
VOXSPRING_HOST_DEVICE constexpr int visit_tile_springs(Visit& visit) {
    int bit = 0;
    UNROLLED
    for (int n = 0; n < tile_particles; ++n) {
        UNROLLED
        for (int m = n + 1; m < tile_particles; ++m) {
            if (is_face_or_edge(tile_x(m) - tile_x(n), tile_y(m) - tile_y(n), tile_z(m) - tile_z(n)))
                visit.both(bit++, n, m);
        }
    }
    UNROLLED
    for (int k = -1; k <= 2; ++k) {
        UNROLLED
        for (int j = -1; j <= 2; ++j) {
            UNROLLED
            for (int i = -1; i <= 2; ++i) {
                const int sides = int(i < 0 || i > 1) + int(j < 0 || j > 1) + int(k < 0 || k > 1);
                if (sides == 0 || sides == 3) continue;  // within the tile; beyond a corner
                visit.point(i, j, k);
                UNROLLED
                for (int n = 0; n < tile_particles; ++n) {
                    if (is_face_or_edge(i - tile_x(n), j - tile_y(n), k - tile_z(n)))
                        visit.half(bit++, n, i, j, k);
                }
            }
        }
    }
    return bit;
}

}  // namespace voxspring::layout
