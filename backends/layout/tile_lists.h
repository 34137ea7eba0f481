// The active tiles of a lattice (2 x 2 x 2 voxels with at least one particle) as a list: their order,
// neighbours and masks (records/tiles.h). Made on the host, without a device.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/layout/records/edit.h"
#include "backends/layout/records/tiles.h"
#include "backends/limits.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// Which tiles of a lattice have a particle. The constructor visits all particles.
struct ActiveTiles {
    explicit ActiveTiles(const Problem& problem);
    std::vector<std::uint8_t> of_lattice;  ///< one per tile of the lattice: 1 if it has a particle, else 0
    std::size_t count = 0;                 ///< number of tiles that have a particle
};

/// The list of active tiles. Tiles begin at voxels whose positions at rest, in units of the spacing, round to
/// even numbers. In a part of a body (decomposition.h) these are the same voxels as in the whole, so that
/// sums have the same order. The active tiles are in canonical order, x fastest. The list begins with a group
/// of tiles without particles (padding) and ends with at least one more such group, since kernels read one
/// tile beyond either end.
class TileLists {
public:
    /// `problem` must have a lattice, and no springs beyond it. `active`: its active tiles. Between the two
    /// groups of padding, the list is filled up to whole blocks of `block_tiles` tiles, a multiple of
    /// group_tiles.
    TileLists(const Problem& problem, const ActiveTiles& active, std::uint32_t block_tiles);

    std::uint32_t blocks() const { return blocks_; }
    /// The number of the tile that has the particle at `voxel`, not counting the padding before it.
    std::uint32_t tile_of(const glm::ivec3& voxel) const { return place_of(voxel).tile - group_tiles; }
    /// The number of elements in an array that has x, y and z for each particle of each listed tile.
    std::size_t elements() const { return 3 * std::size_t(tile_particles) * masks_.size(); }
    /// The index of the x of the particle at `voxel`. Its y and z follow at distances of tile_axis.
    std::size_t element(const glm::ivec3& voxel) const;

    const std::vector<TileRow>& rows() const { return rows_; }
    const std::vector<TileMask>& masks() const { return masks_; }

    /// Updates the masks for an edit. Returns the mask words that change. A tile has four words.
    std::vector<EditedWord> edit(const SpringEdit& edit);

private:
    /// The tile of a particle, and the particle's number in the tile.
    struct Place {
        std::uint32_t tile;
        int number;
    };
    Place place_of(const glm::ivec3& voxel) const;
    void find_rows();
    TileMask mask_of(std::uint32_t tile) const;

    glm::ivec3 begin_;                  ///< coordinates of voxel (0, 0, 0) in its tile, each 0 or 1
    glm::ivec3 voxels_;                 ///< Lattice::dims
    glm::ivec3 dims_;                   ///< tiles along each axis
    std::vector<std::uint32_t> voxel_;  ///< Lattice::voxel
    /// Per tile of the lattice: its number in the list; no_particle: the tile has no particle.
    std::vector<std::uint32_t> number_;
    /// The neighbour masks of the particles of each listed tile.
    std::vector<std::array<std::uint32_t, tile_particles>> bits_;
    std::vector<TileRow> rows_;
    std::vector<TileMask> masks_;
    std::uint32_t blocks_ = 0;
};

/// TileLists::elements() of lists for blocks of `block_tiles` tiles, without making them.
std::size_t tile_elements(const ActiveTiles& active, std::uint32_t block_tiles);

/// How many threads the kernel should have per tile: one or two. Two threads evaluate a tenth more springs in
/// all, but keep the whole card busy if the body has few tiles. `resident`: the number of tiles that the card
/// steps at once with one thread per tile.
unsigned threads_per_tile(std::size_t tiles, std::size_t resident);

/// An upper bound of the device memory, in bytes, of the lists and of `arrays` arrays of vectors, for blocks
/// of `block_tiles` tiles. It counts tiles without making the lists.
template <class Real>
std::uint64_t tile_bytes(const Problem& problem, std::uint32_t block_tiles, int arrays);

/// The least work of a step: bytes and operations.
template <class Real>
StepWork tile_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
