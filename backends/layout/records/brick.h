// The arguments of the brick kernel (cuda/kernels/brick.h): how a block covers its brick of the lattice,
// where in shared memory a particle lies, and the springs that a thread evaluates in the order of its masks'
// bits.
#pragma once

#include "backends/layout/records/march.h"
#include "backends/layout/records/resident.h"

namespace voxspring::cuda {

/// A block has wx x wy x wz threads. Each thread has one tile of tx x ty x tz particles. X, Y, Z are
/// coordinates in the brick, i, j, k those in a tile; -1 and what follows the last are in the frame around
/// them.
struct BrickShape {
    int tx, ty, tz;
    int wx, wy, wz;
    bool both;               ///< bricks have neighbours on either side along x, rather than where X ends
    int row_pad, plane_pad;  ///< words that keep lanes in different banks

    VOXSPRING_HOST_DEVICE constexpr int tile() const { return tx * ty * tz; }
    VOXSPRING_HOST_DEVICE constexpr int threads() const { return wx * wy * wz; }
    /// Threads in whole warps: the last ones may have no tile.
    VOXSPRING_HOST_DEVICE constexpr int lanes() const { return (threads() + 31) / 32 * 32; }
    VOXSPRING_HOST_DEVICE constexpr int nx() const { return tx * wx; }
    VOXSPRING_HOST_DEVICE constexpr int ny() const { return ty * wy; }
    VOXSPRING_HOST_DEVICE constexpr int nz() const { return tz * wz; }

    // A row holds its particles by i: the i-th ones of all tiles are neighbours, so that lanes with tiles in
    // a row are in different banks. The frame's point at X = nx follows the first ones; the one at X = -1, if
    // there is one, is in front of the last ones.
    VOXSPRING_HOST_DEVICE constexpr int column(int i) const {
        const int of = i < 0     ? tx - 1
                       : i == tx ? 0
                                 : i;  // the column that holds it, of a tile beside this one
        const int begin = both ? of * (wx + 1) + (of == tx - 1 ? 1 : 0) : of * wx + (of > 0 ? 1 : 0);
        return begin + (i < 0 ? -1 : i == tx ? 1 : 0);
    }
    VOXSPRING_HOST_DEVICE constexpr int row_length() const { return both ? tx * (wx + 1) + 1 : tx * wx + 1; }
    VOXSPRING_HOST_DEVICE constexpr int pitch() const { return row_length() + row_pad; }
    VOXSPRING_HOST_DEVICE constexpr int plane() const { return (ny() + 2) * pitch() + plane_pad; }
    VOXSPRING_HOST_DEVICE constexpr int axis() const { return (nz() + 2) * plane(); }
    /// Words of the points of every second step.
    VOXSPRING_HOST_DEVICE constexpr int half() const { return 3 * axis(); }
    /// In front of the first row, where X = -1 may be read.
    static constexpr int guard = 1;
    VOXSPRING_HOST_DEVICE constexpr int shared_words() const { return guard + 2 * half(); }
    VOXSPRING_HOST_DEVICE constexpr int shared_bytes() const { return int(sizeof(float)) * shared_words(); }

    /// The slot of particle (i, Y, Z) of the tile at `tile_x`, in the first half and axis.
    VOXSPRING_HOST_DEVICE constexpr int slot(int tile_x, int i, int Y, int Z) const {
        return guard + (Z + 1) * plane() + (Y + 1) * pitch() + column(i) + tile_x;
    }
    /// The slot of point (X, Y, Z), the frame included.
    VOXSPRING_HOST_DEVICE constexpr int slot_of(int X, int Y, int Z) const {
        if (X < 0) return slot(0, -1, Y, Z);
        if (X == nx()) return slot(wx - 1, tx, Y, Z);
        return slot(X / tx, X % tx, Y, Z);
    }

    /// The sides of a tile that the way to its neighbour (i, j, k) leads across, as bits, of those at which a
    /// body may end. Beyond j = -1 and k = -1 it goes on: tiles are mirrored there (TilePlace).
    VOXSPRING_HOST_DEVICE constexpr std::uint32_t crossed(int i, int j, int k) const {
        return (i < 0 ? 1U : 0U) | (i == tx ? 2U : 0U) | (j == ty ? 4U : 0U) | (k == tz ? 8U : 0U);
    }
    static constexpr std::uint32_t sides = 4;  ///< of those

    /// The number of a particle in its tile.
    VOXSPRING_HOST_DEVICE constexpr int number(int i, int j, int k) const { return (k * ty + j) * tx + i; }
    bool operator==(const BrickShape&) const = default;
};

/// Sides of a brick on which there is another, as bits.
inline constexpr std::uint32_t brick_low_x = 1, brick_high_x = 2, brick_low_y = 4, brick_high_y = 8,
                               brick_low_z = 16, brick_high_z = 32;

struct BrickBlock {
    int x, y, z;          ///< voxel of (0, 0, 0)
    int direction;        ///< of X along x, 1 or -1
    std::uint32_t sides;  ///< in the brick's coordinates
    bool operator==(const BrickBlock&) const = default;
};

/// Where a thread's tile lies. Tiles are mirrored along y and z where that brings the border of a brick to
/// the tile's end: what comes from other blocks is always there, and late in a step.
struct TilePlace {
    int slot;                 ///< of its particle (0, 0, 0), in the first half and axis
    int sy, sz;               ///< slots to the next j and k
    int dx, dy, dz;           ///< 1, or -1 where i, j or k runs against the lattice
    int x, y, z;              ///< voxel of its particle (0, 0, 0)
    std::uint32_t published;  ///< a bit for each particle at the border of the brick

    VOXSPRING_HOST_DEVICE TilePlace(BrickShape shape, const BrickBlock& block, int thread) {
        // Rows of tiles follow each other along z: a few more words per plane keep their banks apart.
        const int tile_x = thread % shape.wx, tile_z = thread / shape.wx % shape.wz,
                  tile_y = thread / (shape.wx * shape.wz);
        const bool turned_y = is_mirrored(tile_y, shape.wy, (block.sides & brick_low_y) != 0),
                   turned_z = is_mirrored(tile_z, shape.wz, (block.sides & brick_low_z) != 0);
        const int X = tile_x * shape.tx, Y = tile_y * shape.ty + (turned_y ? shape.ty - 1 : 0),
                  Z = tile_z * shape.tz + (turned_z ? shape.tz - 1 : 0);
        slot = shape.slot(tile_x, 0, Y, Z);
        dx = block.direction;
        dy = turned_y ? -1 : 1;
        dz = turned_z ? -1 : 1;
        sy = dy * shape.pitch();
        sz = dz * shape.plane();
        x = block.x + dx * X;
        y = block.y + Y;
        z = block.z + Z;
        published = 0;
        UNROLLED
        for (int k = 0; k < shape.tz; ++k) {
            UNROLLED
            for (int j = 0; j < shape.ty; ++j) {
                UNROLLED
                for (int i = 0; i < shape.tx; ++i) {
                    if (at_side(block.sides, X + i, shape.nx()) ||
                        at_side(block.sides >> 2, Y + dy * j, shape.ny()) ||
                        at_side(block.sides >> 4, Z + dz * k, shape.nz()))
                        published |= 1U << shape.number(i, j, k);
                }
            }
        }
    }

    VOXSPRING_HOST_DEVICE int slot_of(BrickShape shape, int i, int j, int k) const {
        return slot + (shape.column(i) - shape.column(0)) + j * sy + k * sz;
    }
    VOXSPRING_HOST_DEVICE std::size_t element_of(int i, int j, int k, std::size_t row,
                                                 std::size_t plane) const {
        return std::size_t(x + dx * i) + row * std::size_t(y + dy * j) + plane * std::size_t(z + dz * k);
    }

private:
    static VOXSPRING_HOST_DEVICE bool is_mirrored(int tile, int tiles, bool low) {
        if (tiles == 1) return low;
        // Every other one, so that lanes beside each other in y or z are in different banks.
        return tiles % 2 == 0 ? tile % 2 == 0 : tile == 0;
    }
    static VOXSPRING_HOST_DEVICE bool at_side(std::uint32_t sides, int at, int size) {
        return (at == 0 && (sides & brick_low_x) != 0) || (at == size - 1 && (sides & brick_high_x) != 0);
    }
};

/// A poller with fewer polls keeps them in registers and looks all of them up at once; another so many in
/// turn.
inline constexpr int kept_polls = 10, polls_in_turn = 6;

/// A point that a block needs of another.
struct alignas(8) BrickPoll {
    std::uint32_t from;  ///< element of the lattice; resident_none: no poll
    std::uint32_t slot;  ///< in the first half and axis
    bool operator==(const BrickPoll&) const = default;
};

/// What a thread's masks say: a bit for each spring of visit_brick_springs(), early ones first, then one for
/// each particle of the tile that moves and one for each that exists. A word of TileSides follows.
struct BrickMask {
    int early, springs, particles;
    VOXSPRING_HOST_DEVICE constexpr int moves(int n) const { return springs + n; }
    VOXSPRING_HOST_DEVICE constexpr int exists(int n) const { return springs + particles + n; }
    /// Words of bits, which is also the number of the word of TileSides.
    VOXSPRING_HOST_DEVICE constexpr int words() const { return (springs + 2 * particles + 31) / 32; }
    VOXSPRING_HOST_DEVICE constexpr int words_in_all() const { return words() + 1; }
};

/// What a thread's masks come to if its tile is full and has all springs but those across some of its sides:
/// bit number BrickShape::crossed() says whether there are springs across these. `plain`: it is such a
/// thread; otherwise there is no bit.
struct TileSides {
    static constexpr std::uint32_t plain = 1U << 31U;
    std::uint32_t bits;

    VOXSPRING_HOST_DEVICE constexpr bool is_plain() const { return (bits & plain) != 0; }
    VOXSPRING_HOST_DEVICE constexpr bool has(std::uint32_t crossed) const {
        return (bits >> crossed & 1U) != 0;
    }
};

/// Everything that a launch needs besides where the particles are. `items` of its base is not used.
struct BrickStep : MarchStep<float> {
    const BrickBlock* blocks;
    const std::uint32_t* masks;     ///< BrickMask::words_in_all() a lane, `lane_count` apart
    std::uint32_t lane_count;       ///< of all blocks
    const BrickPoll* polls;         ///< rounds x blocks x pollers
    TaggedPoint* exchange;          ///< 2 x `axis`, by element
    float* increments;              ///< BrickTile::increment_words a block, if they are not in registers
    std::uint32_t* started_blocks;  ///< that have read their start, of all launches
    WaitLimit wait;
    bool operator==(const BrickStep&) const = default;
};

/// Whether a spring leads along (x, y, z), up to 1 each: those of faces and edges.
VOXSPRING_HOST_DEVICE constexpr bool is_face_or_edge(int x, int y, int z) {
    const int squared = x * x + y * y + z * z;
    return squared == 1 || squared == 2;
}

/// Every spring that a thread evaluates before (`late` = false) or after what is late has come, each with its
/// bit, which begin at `bit`. visit.both(bit, i, j, k, i2, j2, k2) is a spring between two particles of its
/// tile, visit.half(...) one from its particle to a point of another's tile, by which that one's thread
/// evaluates it too. Returns the bit after the last.
template <int tx, int ty, int tz, bool both_x, bool late, class Visit>
VOXSPRING_HOST_DEVICE constexpr int visit_brick_springs(Visit& visit, int bit) {
    UNROLLED
    for (int k = -1; k <= tz; ++k) {
        UNROLLED
        for (int j = -1; j <= ty; ++j) {
            UNROLLED
            for (int i = -1; i <= tx; ++i) {
                const bool own = i >= 0 && i < tx && j >= 0 && j < ty && k >= 0 && k < tz;
                const bool is_late = i == tx || (both_x && i == -1) || j == ty || k == tz;
                if (is_late != late) continue;
                UNROLLED
                for (int dz = -1; dz <= 1; ++dz) {
                    UNROLLED
                    for (int dy = -1; dy <= 1; ++dy) {
                        UNROLLED
                        for (int dx = -1; dx <= 1; ++dx) {
                            const int i2 = i + dx, j2 = j + dy, k2 = k + dz;
                            if (!is_face_or_edge(dx, dy, dz)) continue;
                            if (i2 < 0 || i2 >= tx || j2 < 0 || j2 >= ty || k2 < 0 || k2 >= tz) continue;
                            if (!own) {
                                visit.half(bit++, i2, j2, k2, i, j, k);
                            } else if (dz < 0 || (dz == 0 && (dy < 0 || (dy == 0 && dx < 0)))) {
                                visit.both(bit++, i2, j2, k2, i, j, k);
                            }
                        }
                    }
                }
            }
        }
    }
    return bit;
}

}  // namespace voxspring::cuda
