#include "backends/layout/tile_lists.h"

#include <algorithm>
#include <glm/common.hpp>

#include "backends/layout/boxes.h"
#include "backends/layout/records/resident.h"
#include "backends/layout/rounding.h"
#include "backends/layout/work.h"

namespace voxspring::layout {
namespace {

/// The coordinates of voxel (0, 0, 0) in its tile of 2 x 2 x 2 voxels, each 0 or 1. They follow from the
/// first particle's position at rest, so that a part of a body has the same tiles as the whole body.
glm::ivec3 begin_in_tile(const Problem& problem) {
    const Lattice& lattice = problem.lattice;
    if (lattice.voxel.empty()) return glm::ivec3(0);
    const glm::ivec3 whole(glm::round(problem.rest_position.front() / lattice.spacing));
    return (whole - lattice.coordinates(lattice.voxel.front())) & 1;
}

glm::ivec3 tiles_along(const Lattice& lattice, const glm::ivec3& begin) {
    return (begin + lattice.dims + 1) / 2;
}

/// The length of the list for `active` tiles with particles, including tiles of padding.
std::uint32_t listed_tiles(std::size_t active, std::uint32_t block_tiles) {
    return std::uint32_t(rounded_up(active, std::size_t(block_tiles))) + 2 * group_tiles;
}

/// Counts the springs that are evaluated for a tile that has all springs: face springs, then edge springs. A
/// spring between two tiles is evaluated for both.
struct Evaluations {
    std::array<std::uint64_t, 2> of_group{};
    constexpr void count(int dx, int dy, int dz) {
        ++of_group[bits_of_class(spring_class(dx, dy, dz)) == FACE_BITS ? 0 : 1];
    }
    constexpr void both(int /*bit*/, int n, int m) {
        count(tile_x(m) - tile_x(n), tile_y(m) - tile_y(n), tile_z(m) - tile_z(n));
    }
    constexpr void point(int /*i*/, int /*j*/, int /*k*/) {}
    constexpr void half(int /*bit*/, int n, int i, int j, int k) {
        count(i - tile_x(n), j - tile_y(n), k - tile_z(n));
    }
};
constexpr std::array<std::uint64_t, 2> evaluations_of_full_tile = [] {
    Evaluations count;
    visit_tile_springs(count);
    return count.of_group;
}();
static_assert(evaluations_of_full_tile[0] + evaluations_of_full_tile[1] == TileMask::springs);

/// Sets the bits of `mask` for the springs that the particles of a tile have. `bits`: the particles'
/// neighbour masks.
struct SetBits {
    const std::array<std::uint32_t, tile_particles>& bits;
    TileMask& mask;

    void set(int bit) const { mask.word[bit / 32] |= 1U << bit % 32; }
    void spring(int bit, int n, int dx, int dy, int dz) const {
        if ((bits[std::size_t(n)] >> bit_of(dx, dy, dz) & 1U) != 0) set(bit);
    }
    void both(int bit, int n, int m) const {
        spring(bit, n, tile_x(m) - tile_x(n), tile_y(m) - tile_y(n), tile_z(m) - tile_z(n));
    }
    void point(int /*i*/, int /*j*/, int /*k*/) const {}
    void half(int bit, int n, int i, int j, int k) const {
        spring(bit, n, i - tile_x(n), j - tile_y(n), k - tile_z(n));
    }
};

}  // namespace

ActiveTiles::ActiveTiles(const Problem& problem) {
    const Lattice& lattice = problem.lattice;
    const glm::ivec3 begin = begin_in_tile(problem), dims = tiles_along(lattice, begin);
    of_lattice.resize(volume(dims));
    for (const std::uint32_t voxel : lattice.voxel)
        of_lattice[index_in(dims, (begin + lattice.coordinates(voxel)) / 2)] = 1;
    count = std::size_t(std::count(of_lattice.begin(), of_lattice.end(), std::uint8_t(1)));
}

TileLists::TileLists(const Problem& problem, const ActiveTiles& active, std::uint32_t block_tiles)
    : begin_(begin_in_tile(problem)),
      voxels_(problem.lattice.dims),
      dims_(tiles_along(problem.lattice, begin_)),
      voxel_(problem.lattice.voxel) {
    number_.assign(active.of_lattice.size(), no_particle);
    std::uint32_t next = group_tiles;
    for (std::size_t cell = 0; cell < number_.size(); ++cell) {
        if (active.of_lattice[cell] != 0) number_[cell] = next++;
    }
    const std::uint32_t listed = listed_tiles(active.count, block_tiles);
    blocks_ = (listed - 2 * group_tiles) / block_tiles;
    bits_.resize(listed);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const Place place = place_of(problem.lattice.coordinates(voxel_[i]));
        bits_[place.tile][std::size_t(place.number)] = problem.lattice.mask[i];
    }
    masks_.resize(listed);
#pragma omp parallel for
    for (std::ptrdiff_t tile = 0; tile < std::ptrdiff_t(listed); ++tile)
        masks_[std::size_t(tile)] = mask_of(std::uint32_t(tile));
    find_rows();
}

TileLists::Place TileLists::place_of(const glm::ivec3& voxel) const {
    const glm::ivec3 at = begin_ + voxel;
    return {number_[index_in(dims_, at / 2)], at.x % 2 + 2 * (at.y % 2) + 4 * (at.z % 2)};
}

std::size_t TileLists::element(const glm::ivec3& voxel) const {
    const Place place = place_of(voxel);
    return tile_element(place.tile, place.number);
}

void TileLists::find_rows() {
    // Rows of padding tiles, and rows outside of the lattice, point at a tile of the first group, which is
    // padding and may be read.
    rows_.assign(tile_rows * masks_.size(), TileRow::make(group_tiles - 1, false));
    // For each tile of the lattice: the list number of the first tile with a particle, from that tile on.
    std::vector<std::uint32_t> from(number_.size());
    std::uint32_t following =
        group_tiles + std::uint32_t(std::count_if(number_.begin(), number_.end(), [](std::uint32_t number) {
            return number != no_particle;
        }));
    for (std::size_t cell = number_.size(); cell-- > 0;) {
        if (number_[cell] != no_particle) following = number_[cell];
        from[cell] = following;
    }
#pragma omp parallel for
    for (int z = 0; z < dims_.z; ++z) {
        for (int y = 0; y < dims_.y; ++y) {
            for (int x = 0; x < dims_.x; ++x) {
                const std::uint32_t tile = number_[index_in(dims_, {x, y, z})];
                if (tile == no_particle) continue;
                TileRow* const rows = rows_.data() +
                                      std::size_t(tile / group_tiles) * tile_rows * group_tiles +
                                      tile % group_tiles;
                for (int dz = -1; dz <= 1; ++dz) {
                    for (int dy = -1; dy <= 1; ++dy) {
                        const glm::ivec3 at(x, y + dy, z + dz);
                        if ((dy == 0 && dz == 0) || at.y < 0 || at.y >= dims_.y || at.z < 0 ||
                            at.z >= dims_.z)
                            continue;
                        const std::size_t cell = index_in(dims_, at);
                        rows[std::size_t(tile_row(dy, dz)) * group_tiles] =
                            TileRow::make(from[cell], number_[cell] != no_particle);
                    }
                }
            }
        }
    }
}

TileMask TileLists::mask_of(std::uint32_t tile) const {
    TileMask mask{};
    SetBits set{bits_[tile], mask};
    visit_tile_springs(set);
    for (int n = 0; n < tile_particles; ++n) {
        const std::uint32_t bits = bits_[tile][std::size_t(n)];
        if (bits != 0 && (bits & PINNED_BIT) == 0) set.set(TileMask::moves(n));
    }
    return mask;
}

std::vector<EditedWord> TileLists::edit(const SpringEdit& edit) {
    std::vector<std::uint32_t> tiles;
    for (const SpringEdit::Touched& touched : edit.touched) {
        const std::uint32_t voxel = voxel_[touched.particle];
        const auto x = std::uint32_t(voxels_.x), y = std::uint32_t(voxels_.y);
        const Place place = place_of(glm::ivec3(voxel % x, voxel / x % y, voxel / (x * y)));
        bits_[place.tile][std::size_t(place.number)] = touched.mask;
        tiles.push_back(place.tile);
    }
    std::sort(tiles.begin(), tiles.end());
    tiles.erase(std::unique(tiles.begin(), tiles.end()), tiles.end());
    std::vector<EditedWord> edited;
    for (const std::uint32_t tile : tiles) {
        const TileMask before = masks_[tile];
        masks_[tile] = mask_of(tile);
        for (std::uint32_t w = 0; w < 4; ++w) {
            if (masks_[tile].word[w] != before.word[w])
                edited.push_back({4 * tile + w, masks_[tile].word[w]});
        }
    }
    return edited;
}

unsigned threads_per_tile(std::size_t tiles, std::size_t resident) { return tiles <= resident ? 2 : 1; }

std::size_t tile_elements(const ActiveTiles& active, std::uint32_t block_tiles) {
    return 3 * std::size_t(tile_particles) * listed_tiles(active.count, block_tiles);
}

template <class Real>
std::uint64_t tile_bytes(const Problem& problem, std::uint32_t block_tiles, int arrays) {
    const std::uint64_t listed = listed_tiles(ActiveTiles(problem).count, block_tiles);
    return listed * (sizeof(TileMask) + tile_rows * sizeof(TileRow) +
                     std::uint64_t(arrays) * tile_particles * sizeof(Vector<Real>));
}

template <class Real>
StepWork tile_work(const Problem& problem, Formulation formulation) {
    // A full lattice has 24 face springs and 48 edge springs per eight particles, that is, per tile.
    StepWork work = shared_springs_work<Real>(
        problem, formulation, {{{evaluations_of_full_tile[0], 24}, {evaluations_of_full_tile[1], 48}}});
    const std::uint64_t tiles = units_of(problem.particle_count(), std::size_t(tile_particles));
    const std::uint64_t lists = tiles * (sizeof(TileMask) + tile_rows * sizeof(TileRow));
    work.bytes += lists;
    work.footprint_bytes += lists;
    return work;
}

#define FOR_PRECISION(Real)                                                      \
    template std::uint64_t tile_bytes<Real>(const Problem&, std::uint32_t, int); \
    template StepWork tile_work<Real>(const Problem&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
