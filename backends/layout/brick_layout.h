// Which block of the brick kernel (cuda/kernels/brick.h) holds which part of the lattice: the shape of bricks
// (boxes of voxels, one per block), chosen by the predicted time of a step; masks; and the points that blocks
// send each other. All this is computed on the host, without a device.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "backends/layout/march_cost.h"
#include "backends/layout/march_layout.h"
#include "backends/layout/records/brick.h"
#include "backends/layout/records/edit.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// The size of a tile, the box of particles that one thread steps.
struct BrickTileSize {
    int x, y, z;
    int particles() const { return x * y * z; }
    bool operator==(const BrickTileSize&) const = default;
};
/// The tile sizes for which the brick kernel can be compiled.
std::span<const BrickTileSize> brick_tile_sizes();

/// How a launch of the brick kernel covers a body.
struct BrickPlan {
    BrickShape shape{};
    int pollers = 0;  ///< threads per block that have no tile and receive the points of other blocks
    /// Pollers send their block's points after each step. If not, threads with tiles do so as they step them.
    bool pollers_send = false;
    /// Registers of a thread with a tile, and of a poller, if the kernel moves registers between them. 0: all
    /// threads have equally many.
    int lane_registers = 0, poller_registers = 0;
    bool increments_in_memory = false;  ///< true if registers have no room for them
    double seconds = 0;                 ///< predicted time of a step
    bool operator==(const BrickPlan&) const = default;
};
/// The plan with the shortest predicted step, with tiles of `size` or, if no size is given, of any size. No
/// plan if the body is too large for the blocks of the device. `moves_registers`: some threads of a block may
/// have more registers than others.
std::optional<BrickPlan> plan_bricks(const Problem& problem, Formulation formulation,
                                     const MarchDevice& device, bool moves_registers,
                                     std::optional<BrickTileSize> size = std::nullopt);

/// Empty, or why a kernel whose threads begin with `compiled` registers each cannot move registers as `plan`
/// asks. If it tried, a thread would wait for ever for registers that no other thread gives up.
std::string registers_refusal(const BrickPlan& plan, int compiled);

/// The tables of BrickStep, and how edits change them.
class BrickLayout {
public:
    /// `problem` has a lattice, at least one particle, and no springs beyond the lattice.
    BrickLayout(const Problem& problem, const BrickPlan& plan);

    const std::vector<BrickBlock>& blocks() const { return blocks_; }
    const std::vector<std::uint32_t>& masks() const { return masks_; }
    /// The points that pollers send or receive, by block, then by round, then by poller (BrickStep).
    struct Points {
        int rounds = 0;
        std::vector<BrickPoint> points;
    };
    const Points& sent() const { return sent_; }
    const Points& received() const { return received_; }
    /// Whether all threads are plain: their tiles are full and have all springs, except those across some of
    /// their sides (TileSides).
    bool all_plain() const;
    std::uint32_t lane_count() const {
        return std::uint32_t(blocks_.size()) * std::uint32_t(plan_.shape.lanes());
    }

    /// Updates the masks for an edit. Returns the mask words that change.
    std::vector<EditedWord> edit(const SpringEdit& edit);

private:
    /// A spring from particle (i, j, k) of a tile to its neighbour at offset (dx, dy, dz), with its mask bit.
    struct TileSpring {
        int i, j, k, dx, dy, dz, bit;
        std::uint32_t crossed;  ///< BrickShape::crossed() of the neighbour
    };
    class ListSprings;
    /// Room for the most words that a thread can have (BrickMask).
    using TileWords = std::array<std::uint32_t, 16>;

    std::uint32_t mask_at(const glm::ivec3& voxel) const;
    void find_blocks();
    void write_masks(std::size_t block, int lane);
    void find_plain_words(std::uint32_t group_bits);
    TileSides sides_of(const TileWords& words) const;
    std::vector<BrickPoint> border_of(const BrickBlock& block, bool inside) const;
    Points in_rounds(const std::vector<std::vector<BrickPoint>>& of_blocks) const;
    void find_points();

    BrickPlan plan_;
    SoaStrides strides_;
    glm::ivec3 dims_, low_{0}, bricks_{1};  ///< lattice's size; body's least coordinates; number of bricks
    std::vector<std::uint32_t> voxel_;      ///< Lattice::voxel
    std::vector<std::uint32_t> mask_;       ///< one per voxel of the lattice
    std::vector<std::uint32_t> block_at_;   ///< per brick: its block; resident_none: it has no particle
    std::vector<TileSpring> springs_;
    BrickMask bits_{};
    /// The mask words of a plain thread (TileSides), without the bits BrickMask::moves(). The index has a bit
    /// for each side of the tile that springs cross.
    std::array<TileWords, 1U << BrickShape::sides> plain_words_{};
    /// For each side of a tile: the bits of the springs that cross this side and no other.
    std::array<TileWords, BrickShape::sides> across_{};
    TileWords moves_{};  ///< mask words with only the bits BrickMask::moves() of all particles
    std::vector<BrickBlock> blocks_;
    std::vector<std::uint32_t> masks_;
    Points sent_, received_;
};

}  // namespace voxspring::layout
