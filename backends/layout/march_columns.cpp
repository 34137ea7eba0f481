#include "backends/layout/march_columns.h"

#include <algorithm>

#include "backends/layout/rounding.h"

namespace voxspring::layout {
namespace {

/// The mask bits of the directions for whose offset chosen(offset) is true.
template <class Chosen>
std::uint32_t bits_where(Chosen chosen) {
    std::uint32_t bits = 0;
    for (const Direction& direction : directions())
        bits |= chosen(direction.offset) ? 1U << direction.bit : 0;
    return bits;
}

}  // namespace

MarchCells::MarchCells(const Problem& problem, int width)
    : lattice_(&problem.lattice),
      width_(width),
      count_(units_of(lattice_->dims.x, width)),
      cells_(std::size_t(count_) * std::size_t(lattice_->dims.y) * std::size_t(lattice_->dims.z)),
      begin_(std::size_t(lattice_->dims.y) * std::size_t(lattice_->dims.z) + 1) {
    begin_.back() = std::uint32_t(lattice_->voxel.size());
#pragma omp parallel for schedule(dynamic)
    for (int z = 0; z < lattice_->dims.z; ++z) fill_plane(problem, z);
}

void MarchCells::fill_plane(const Problem& problem, int z) {
    static const std::uint32_t left = bits_where([](glm::ivec3 o) { return o.x < 0; });
    static const std::uint32_t right = bits_where([](glm::ivec3 o) { return o.x > 0; });
    static const std::uint32_t below = bits_where([](glm::ivec3 o) { return o.z < 0; });
    static const std::uint32_t above = bits_where([](glm::ivec3 o) { return o.z > 0; });
    const glm::ivec3 dims = lattice_->dims;
    std::uint32_t wanted = (problem.group_bits & (FACE_BITS | EDGE_BITS)) | ACTIVE_BIT;
    if (z == 0) wanted &= ~below;
    if (z + 1 == dims.z) wanted &= ~above;

    const std::vector<std::uint32_t>& voxels = lattice_->voxel;
    auto row_begin = std::size_t(z) * std::size_t(dims.y) * std::size_t(dims.x);
    auto n = std::size_t(std::lower_bound(voxels.begin(), voxels.end(), row_begin) - voxels.begin());
    for (int y = 0; y < dims.y; ++y, row_begin += std::size_t(dims.x)) {
        begin_[row_number(y, z)] = std::uint32_t(n);
        std::uint8_t* const cells = &cells_[row_number(y, z) * std::size_t(count_)];
        for (int cell = 0; cell < count_; ++cell) {
            const std::size_t begin = row_begin + std::size_t(cell) * std::size_t(width_);
            const std::size_t end = std::min(begin + std::size_t(width_), row_begin + std::size_t(dims.x));
            int particles = 0;
            bool all = true;
            for (; n < voxels.size() && voxels[n] < end; ++n, ++particles) {
                std::uint32_t asked = wanted;
                if (voxels[n] == row_begin) asked &= ~left;
                if (voxels[n] + 1 == row_begin + std::size_t(dims.x)) asked &= ~right;
                all = all && (lattice_->mask[n] & (asked | PINNED_BIT)) == asked;
            }
            if (particles > 0) cells[cell] |= active;
            if (particles == width_ && all) cells[cell] |= full;
        }
    }
}

MarchColumns::MarchColumns(const MarchCells& cells, const MarchShape& shape)
    : shape_(shape),
      across_(units_of(cells.lattice().dims.x, shape.width())),
      down_(units_of(cells.lattice().dims.y, shape.height())),
      planes_(cells.lattice().dims.z),
      warps_(std::size_t(count()) * std::size_t(planes_)) {
    const glm::ivec3 dims = cells.lattice().dims;
    const int cells_of_warp = 2 * shape.lanes / cells.width();
    const int rows_of_warp = shape.rows * (32 / shape.lanes);
    const int warps_across = across_ * shape.wide;
#pragma omp parallel for schedule(dynamic)
    for (int z = 0; z < planes_; ++z) {
        for (int y = 0; y < down_ * shape.height(); y += rows_of_warp) {
            for (int w = 0; w < warps_across; ++w) {
                std::uint8_t any = 0, all = y + rows_of_warp <= dims.y ? MarchCells::full : 0;
                for (int j = y; j < std::min(y + rows_of_warp, dims.y); ++j) {
                    const std::uint8_t* const row = cells.row(j, z);
                    for (int c = w * cells_of_warp; c < (w + 1) * cells_of_warp; ++c) {
                        const std::uint8_t cell = c < cells.count() ? row[c] : std::uint8_t(0);
                        any |= cell;
                        all &= cell;
                    }
                }
                if ((any & MarchCells::active) == 0) continue;
                const int column = y / shape.height() * across_ + w / shape.wide;
                const int warp = y % shape.height() / rows_of_warp * shape.wide + w % shape.wide;
                MarchWarps& at = warps_[std::size_t(column) * std::size_t(planes_) + std::size_t(z)];
                at.active |= 1U << warp;
                if (all != 0) at.full |= 1U << warp;
            }
        }
    }
}

}  // namespace voxspring::layout
