// Describes a body for the planning of cuda_march (march_plan.h). It does not describe each voxel but each
// run of voxels along x, as long as a warp or a part of one is wide.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "backends/layout/records/march.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// Divides every row of a lattice into cells of `width` voxels, a power of two of at most 128, and stores
/// flags for each cell.
class MarchCells {
public:
    MarchCells(const Problem& problem, int width);

    static constexpr std::uint8_t active = 1;  ///< flag: the cell has a particle
    /// Flag: every voxel of the cell has a particle that moves and has every spring. Only springs that would
    /// leave the lattice across its first or last x, or its first or last plane, may be missing.
    static constexpr std::uint8_t full = 2;

    const Lattice& lattice() const { return *lattice_; }
    int width() const { return width_; }
    int count() const { return count_; }  ///< cells per row
    /// The flags of the count() cells in row (y, z) of the lattice.
    const std::uint8_t* row(int y, int z) const { return &cells_[row_number(y, z) * std::size_t(count_)]; }
    /// first_particle(): the index of the first particle in row (y, z) or, if the row has none, of the first
    /// particle after it. end_particle(): the index after the row's last particle.
    std::size_t first_particle(int y, int z) const { return begin_[row_number(y, z)]; }
    std::size_t end_particle(int y, int z) const { return begin_[row_number(y, z) + 1]; }

private:
    std::size_t row_number(int y, int z) const {
        return std::size_t(z) * std::size_t(lattice_->dims.y) + std::size_t(y);
    }
    void fill_plane(const Problem& problem, int z);

    const Lattice* lattice_;
    int width_, count_;
    std::vector<std::uint8_t> cells_;
    std::vector<std::uint32_t> begin_;
};

/// One bit for each warp of a block, in one plane of its tile.
struct MarchWarps {
    std::uint32_t active = 0;  ///< bit w: warp w has a particle
    std::uint32_t full = 0;    ///< bit w: all cells of warp w are MarchCells::full
};

/// Divides a lattice into columns along z, whose cross-section is one tile, the particles that a block steps
/// per plane.
class MarchColumns {
public:
    /// The width of `cells` must divide the width of a warp in voxels, 2 * shape.lanes.
    MarchColumns(const MarchCells& cells, const MarchShape& shape);

    const MarchShape& shape() const { return shape_; }
    int count() const { return across_ * down_; }
    int planes() const { return planes_; }
    /// x(), y(): the coordinates of the first voxel of column `number`.
    int x(int number) const { return number % across_ * shape_.width(); }
    int y(int number) const { return number / across_ * shape_.height(); }
    const MarchWarps& at(int number, int z) const {
        return warps_[std::size_t(number) * std::size_t(planes_) + std::size_t(z)];
    }

private:
    MarchShape shape_;
    int across_, down_, planes_;
    std::vector<MarchWarps> warps_;
};

}  // namespace voxspring::layout
