// The active tiles of a lattice as a list (records/tiles.h): their order, their neighbours and masks. Built
// on the host, without a device.
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

/// Which tiles of a lattice have a particle. Found by a pass over all particles.
struct ActiveTiles {
    explicit ActiveTiles(const Problem& problem);
    std::vector<std::uint8_t> of_lattice;  ///< one per tile of the lattice: 1 if it has a particle, else 0
    std::size_t count = 0;                 ///< number of tiles that have a particle
};

/// Tiles begin at even voxels. In a part of a body (decomposition.h) these are even voxels of the whole body,
/// so that sums have the same order in the part as in the whole. The list has the active tiles in canonical
/// order, x fastest. It begins with a group of padding and ends with at least one more, since kernels read
/// one tile beyond either end.
class TileLists {
public:
    /// `problem` has a lattice, and no springs beyond it. `active`: its tiles. Between the two groups of
    /// padding, the list is filled up to whole blocks of `block_tiles` tiles, a multiple of group_tiles.
    TileLists(const Problem& problem, const ActiveTiles& active, std::uint32_t block_tiles);

    std::uint32_t blocks() const { return blocks_; }
    /// The number of the tile that has the particle at `voxel`, not counting the padding before it.
    std::uint32_t tile_of(const glm::ivec3& voxel) const { return place_of(voxel).tile - group_tiles; }
    /// The number of components in an array that has a vector for each particle of each listed tile.
    std::size_t elements() const { return 3 * std::size_t(tile_particles) * masks_.size(); }
    /// The element of the x of the particle at `voxel`. y and z follow at distances of tile_axis.
    std::size_t element(const glm::ivec3& voxel) const;

    const std::vector<TileRow>& rows() const { return rows_; }
    const std::vector<TileMask>& masks() const { return masks_; }

    /// Updates the masks for an edit. Returns the mask words that it changes, four per tile.
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
    std::vector<std::uint32_t>
        number_;  ///< per tile of the lattice: its number in the list; no_particle: not active
    std::vector<std::array<std::uint32_t, tile_particles>>
        bits_;  ///< masks of the particles of each listed tile
    std::vector<TileRow> rows_;
    std::vector<TileMask> masks_;
    std::uint32_t blocks_ = 0;
};

/// How many threads a kernel has per tile: one or two. Two evaluate a tenth more springs in all, but fill the
/// card if the body has few tiles. `resident`: tiles that the card steps at once, with one thread each.
unsigned threads_per_tile(std::size_t tiles, std::size_t resident);

/// An upper bound of the device memory of the lists and of `arrays` arrays of vectors, for blocks of
/// `block_tiles` tiles. It counts tiles without making the lists.
template <class Real>
std::uint64_t tile_bytes(const Problem& problem, std::uint32_t block_tiles, int arrays);

/// The least work of a step.
template <class Real>
StepWork tile_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
