// The arguments of the brick kernel (cuda/kernels/brick.h), whose blocks each step one brick, a box of the
// lattice: how a block covers its brick, where a particle lies in shared memory, and the springs that each
// thread evaluates, in the order of the bits of its masks.
#pragma once

#include "backends/layout/records/march.h"
#include "backends/layout/records/resident.h"

namespace voxspring::layout {

/// A block has wx x wy x wz threads with one tile of tx x ty x tz particles each. X, Y, Z are coordinates in
/// the brick; i, j, k are coordinates in a tile. A coordinate of -1, or one more than the largest, lies in
/// the frame of neighbouring points around the brick or tile.
struct BrickShape {
    int tx, ty, tz;
    int wx, wy, wz;
    /// Whether a brick may have neighbouring bricks on both sides along x. If not, it may have one only where
    /// X ends.
    bool both;
    int row_pad, plane_pad;  ///< padding words that put lanes into different banks

    VOXSPRING_HOST_DEVICE constexpr int tile() const { return tx * ty * tz; }
    VOXSPRING_HOST_DEVICE constexpr int threads() const { return wx * wy * wz; }
    /// The number of threads, rounded up to whole warps. The last lanes may have no tile.
    VOXSPRING_HOST_DEVICE constexpr int lanes() const { return (threads() + 31) / 32 * 32; }
    VOXSPRING_HOST_DEVICE constexpr int nx() const { return tx * wx; }
    VOXSPRING_HOST_DEVICE constexpr int ny() const { return ty * wy; }
    VOXSPRING_HOST_DEVICE constexpr int nz() const { return tz * wz; }

    // In shared memory a row of particles is ordered by i: the i-th particles of all tiles lie side by side,
    // so that lanes whose tiles are in one row use different banks. The frame is the layer of points around
    // the brick. The frame's point at X = nx is stored after the particles with i = 0. If `both` is true, the
    // frame's point at X = -1 is stored before the particles with i = tx - 1.
    VOXSPRING_HOST_DEVICE constexpr int column(int i) const {
        const int of = i < 0     ? tx - 1
                       : i == tx ? 0
                                 : i;  // the particle's i in its tile, which may be the tile beside this one
        const int begin = both ? of * (wx + 1) + (of == tx - 1 ? 1 : 0) : of * wx + (of > 0 ? 1 : 0);
        return begin + (i < 0 ? -1 : i == tx ? 1 : 0);
    }
    VOXSPRING_HOST_DEVICE constexpr int row_length() const { return both ? tx * (wx + 1) + 1 : tx * wx + 1; }
    VOXSPRING_HOST_DEVICE constexpr int pitch() const { return row_length() + row_pad; }
    VOXSPRING_HOST_DEVICE constexpr int plane() const { return (ny() + 2) * pitch() + plane_pad; }
    VOXSPRING_HOST_DEVICE constexpr int axis() const { return (nz() + 2) * plane(); }
    /// The number of words in each half of the shared memory for points. Steps use the two halves in turn.
    VOXSPRING_HOST_DEVICE constexpr int half() const { return 3 * axis(); }
    /// The number of words before the first row: if tx is 1, the word before the row may be read in place of
    /// a point at X = -1.
    static constexpr int guard = 1;
    VOXSPRING_HOST_DEVICE constexpr int shared_words() const { return guard + 2 * half(); }
    VOXSPRING_HOST_DEVICE constexpr int shared_bytes() const { return int(sizeof(float)) * shared_words(); }

    /// The slot of a particle, which is the index in shared memory, in words, of its x in the first half
    /// (half()). The particle has coordinate i along x in its tile, and the tile is number `tile_x` along x
    /// in the brick. Y and Z are coordinates in the brick.
    VOXSPRING_HOST_DEVICE constexpr int slot(int tile_x, int i, int Y, int Z) const {
        return guard + (Z + 1) * plane() + (Y + 1) * pitch() + column(i) + tile_x;
    }
    /// The slot of point (X, Y, Z), which may lie in the frame.
    VOXSPRING_HOST_DEVICE constexpr int slot_of(int X, int Y, int Z) const {
        if (X < 0) return slot(0, -1, Y, Z);
        if (X == nx()) return slot(wx - 1, tx, Y, Z);
        return slot(X / tx, X % tx, Y, Z);
    }

    /// The sides of a tile, as bits, that a spring from the tile to point (i, j, k) crosses. The sides at j =
    /// -1 and k = -1 do not count: tiles are mirrored (TilePlace), so that the brick goes on there unless it
    /// is one tile thick.
    VOXSPRING_HOST_DEVICE constexpr std::uint32_t crossed(int i, int j, int k) const {
        return (i < 0 ? 1U : 0U) | (i == tx ? 2U : 0U) | (j == ty ? 4U : 0U) | (k == tz ? 8U : 0U);
    }
    static constexpr std::uint32_t sides = 4;  ///< number of bits of crossed()

    /// Whether another brick may lie beside particle (i, j, k) of a tile: along y and z at the tile's far
    /// ends alone, since tiles are mirrored (TilePlace).
    VOXSPRING_HOST_DEVICE constexpr bool may_be_at_border(int i, int j, int k) const {
        return i == tx - 1 || (both && i == 0) || j == ty - 1 || k == tz - 1;
    }

    /// The number of particle (i, j, k) in its tile.
    VOXSPRING_HOST_DEVICE constexpr int number(int i, int j, int k) const { return (k * ty + j) * tx + i; }
    bool operator==(const BrickShape&) const = default;
};

/// Bits for the sides of a brick. A bit is set if another brick lies beside that side.
inline constexpr std::uint32_t brick_low_x = 1, brick_high_x = 2, brick_low_y = 4, brick_high_y = 8,
                               brick_low_z = 16, brick_high_z = 32;

struct BrickBlock {
    int x, y, z;          ///< voxel of the brick's particle (0, 0, 0)
    int direction;        ///< 1 if X runs along the lattice's x, -1 if against it
    std::uint32_t sides;  ///< brick_low_x etc., in the brick's coordinates
    bool operator==(const BrickBlock&) const = default;
};

/// Where a thread's tile lies. Tiles are mirrored along y or z so that every side of the brick with another
/// brick beside it is at a tile's far end (j = ty - 1, k = tz - 1). So along y and z points of other blocks
/// are needed only beyond the far end, and the springs to these points are added late in a step.
struct TilePlace {
    int slot;        ///< slot of the tile's particle (0, 0, 0) (BrickShape::slot())
    int sy, sz;      ///< slots from one j to the next, and from one k to the next
    int dx, dy, dz;  ///< 1, or -1 where i, j or k runs against the lattice
    int x, y, z;     ///< voxel of the tile's particle (0, 0, 0)

    VOXSPRING_HOST_DEVICE TilePlace(BrickShape shape, const BrickBlock& block, int thread) {
        // Successive threads have a row of tiles along x, then the next row along z. plane_pad puts these
        // rows into different banks.
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
    }

    /// Bit number(i, j, k): another brick lies beside the particle.
    VOXSPRING_HOST_DEVICE std::uint32_t border(BrickShape shape, const BrickBlock& block) const {
        const int X = dx * (x - block.x), Y = y - block.y, Z = z - block.z;
        std::uint32_t bits = 0;
        UNROLLED
        for (int k = 0; k < shape.tz; ++k) {
            UNROLLED
            for (int j = 0; j < shape.ty; ++j) {
                UNROLLED
                for (int i = 0; i < shape.tx; ++i) {
                    if (at_side(block.sides, X + i, shape.nx()) ||
                        at_side(block.sides >> 2, Y + dy * j, shape.ny()) ||
                        at_side(block.sides >> 4, Z + dz * k, shape.nz()))
                        bits |= 1U << shape.number(i, j, k);
                }
            }
        }
        return bits;
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
        // If the number of tiles is even, every second one is mirrored, so that lanes beside each other in y
        // or z are in different banks.
        return tiles % 2 == 0 ? tile % 2 == 0 : tile == 0;
    }
    static VOXSPRING_HOST_DEVICE bool at_side(std::uint32_t sides, int at, int size) {
        return (at == 0 && (sides & brick_low_x) != 0) || (at == size - 1 && (sides & brick_high_x) != 0);
    }
};

/// A poller is a thread without a tile. It sends the points of this block before the first step and, if
/// BrickPlan::pollers_send, after each step. It waits for the points of other blocks: if they are fewer than
/// kept_polls, it looks them all up at once and keeps each BrickPoint in registers; otherwise it looks up
/// polls_in_turn at a time.
inline constexpr int kept_polls = 10, polls_in_turn = 6;

/// A point that a block sends to other blocks, or receives from another one.
struct alignas(8) BrickPoint {
    std::uint32_t element;  ///< index of the point's lattice element; resident_none: no point
    std::uint32_t slot;     ///< where the block has the point in shared memory (BrickShape::slot())
    bool operator==(const BrickPoint&) const = default;
};

/// The bits of a thread's masks, from the lowest on: one per spring of visit_brick_springs(), set if the
/// spring exists, first the `early` springs that need no point of another block (visited with `late` false);
/// one per particle of the tile, set if it moves; and one per particle, set if it exists. After the words of
/// bits comes one more word, a TileSides.
struct BrickMask {
    int early, springs, particles;
    VOXSPRING_HOST_DEVICE constexpr int moves(int n) const { return springs + n; }
    VOXSPRING_HOST_DEVICE constexpr int exists(int n) const { return springs + particles + n; }
    /// The number of words of bits. The word after them, which has this index, is a TileSides.
    VOXSPRING_HOST_DEVICE constexpr int words() const { return (springs + 2 * particles + 31) / 32; }
    VOXSPRING_HOST_DEVICE constexpr int words_in_all() const { return words() + 1; }
};

/// Summarises the masks of a thread. Bit `plain` is set if the tile has all its particles and has all
/// springs, except those across some of its sides. Then bit n > 0 is set if the tile has the springs for
/// which BrickShape::crossed() is n. If the tile is not plain, no bit is set.
struct TileSides {
    static constexpr std::uint32_t plain = 1U << 31U;
    std::uint32_t bits;

    VOXSPRING_HOST_DEVICE constexpr bool is_plain() const { return (bits & plain) != 0; }
    VOXSPRING_HOST_DEVICE constexpr bool has(std::uint32_t crossed) const {
        return (bits >> crossed & 1U) != 0;
    }
};

/// What the brick kernel is launched with, besides the state, the number of steps and two counters. Members
/// `nx`, `ny`, `nz`, `items` and `words` of the base class are not used.
struct BrickStep : MarchStep<float> {
    const BrickBlock* blocks;
    const std::uint32_t* masks;  ///< BrickMask::words_in_all() per lane, `lane_count` apart
    std::uint32_t lane_count;    ///< number of lanes of all blocks together
    /// The points that pollers send and receive, each ordered by block, then by round, then by poller.
    const BrickPoint* sent;
    const BrickPoint* received;
    /// Blocks send each other points through these 2 x `axis` places. Steps use two halves in turn; each half
    /// is indexed by lattice element.
    TaggedPoint* exchange;
    float* increments;  ///< BrickTile::increment_words per block; used if not in registers
    WaitLimit wait;
    bool operator==(const BrickStep&) const = default;
};

/// Whether a voxel at offset (x, y, z) from another shares a face or an edge with it. Bricks and tiles have
/// no other springs.
VOXSPRING_HOST_DEVICE constexpr bool is_face_or_edge(int x, int y, int z) {
    const int squared = x * x + y * y + z * z;
    return squared == 1 || squared == 2;
}

/// Visits the springs that a thread evaluates, each with its mask bit; bits begin at `bit`. If `late` is
/// true, it visits the springs to points beyond a side where another block may begin; otherwise all others.
/// visit.both(bit, i, j, k, i2, j2, k2) is a spring between two particles of the tile. visit.half(...) is a
/// spring from a particle of the tile to a point of another tile, whose thread evaluates it too. Returns the
/// bit after the last one.
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

}  // namespace voxspring::layout
