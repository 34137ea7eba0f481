#include "backends/layout/blocks.h"

#include <algorithm>
#include <numeric>
#include <sstream>
#include <utility>

#include "backends/layout/boxes.h"
#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"
#include "backends/layout/vectors.h"

namespace voxspring::layout {
namespace {

/// Puts the blocks for which is_border(block) is true before the others. Within both parts blocks keep their
/// order.
template <class Block, class IsBorder>
BlockParts<Block> parted(std::vector<Block> blocks, IsBorder is_border) {
    const auto interior = std::stable_partition(blocks.begin(), blocks.end(), is_border);
    const auto border = std::size_t(interior - blocks.begin());
    return {std::move(blocks), border};
}

}  // namespace

BlockShape BlockShape::parse(const std::string& text) {
    BlockShape shape;
    std::istringstream stream(text);
    char separator = 0;
    stream >> shape.x >> separator >> shape.y >> separator >> shape.z;
    shape.y = std::max(shape.y, 1);
    shape.z = std::max(shape.z, 1);
    return shape;
}

BlockGrid::BlockGrid(const Lattice& lattice, BlockShape shape)
    : shape_(shape),
      row_(std::size_t(units_of(lattice.dims.x, shape.x)) + 2),
      slice_((std::size_t(units_of(lattice.dims.y, shape.y)) + 2) * row_),
      places_((std::size_t(units_of(lattice.dims.z, shape.z)) + 2) * slice_) {}

std::vector<BlockOrigin> list_blocks(const Lattice& lattice, BlockShape shape) {
    const BlockGrid grid(lattice, shape);
    std::vector<std::uint8_t> active(grid.places());
    for (const std::uint32_t voxel : lattice.voxel) active[grid.place_of(lattice, voxel)] = 1;
    std::vector<BlockOrigin> origins;
    const glm::ivec3 size(shape.x, shape.y, shape.z), blocks = (lattice.dims + size - 1) / size;
    visit_box(glm::ivec3(0), blocks, [&](const glm::ivec3& at) {
        const std::size_t place = grid.place(at.x, at.y, at.z);
        if (active[place] != 0)
            origins.push_back({at.x * shape.x, at.y * shape.y, at.z * shape.z, int(place)});
    });
    return origins;
}

std::vector<BlockOrigin> occupied_blocks(const Lattice& lattice, BlockShape shape) {
    std::vector<BlockOrigin> origins = list_blocks(lattice, shape);
    const std::int64_t all = std::int64_t(units_of(lattice.dims.x, shape.x)) *
                             units_of(lattice.dims.y, shape.y) * units_of(lattice.dims.z, shape.z);
    if (std::int64_t(origins.size()) == all && fits_launch(lattice, shape)) return {};
    return origins;
}

bool fits_launch(const Lattice& lattice, BlockShape shape) {
    constexpr int max_blocks = 65535;  // along y and z
    return units_of(lattice.dims.y, shape.y) <= max_blocks && units_of(lattice.dims.z, shape.z) <= max_blocks;
}

BlockParts<BlockOrigin> part_blocks(const Lattice& lattice, BlockShape shape,
                                    const std::vector<std::uint32_t>& border) {
    const BlockGrid grid(lattice, shape);
    std::vector<std::uint8_t> touched(grid.places());
    for (const std::uint32_t i : border) touched[grid.place_of(lattice, lattice.voxel[i])] = 1;
    return parted(list_blocks(lattice, shape),
                  [&](const BlockOrigin& block) { return touched[std::size_t(block.place)] != 0; });
}

BlockParts<std::uint32_t> part_blocks(std::size_t particles, unsigned block,
                                      const std::vector<std::uint32_t>& border) {
    std::vector<std::uint32_t> blocks(units_of(particles, std::size_t(block)));
    std::iota(blocks.begin(), blocks.end(), 0U);
    std::vector<std::uint8_t> touched(blocks.size());
    for (const std::uint32_t i : border) touched[i / block] = 1;
    return parted(std::move(blocks), [&](std::uint32_t number) { return touched[number] != 0; });
}

template <class Real>
ImplicitStep<Real> make_implicit_step(const Problem& problem, const Placement& placement,
                                      Formulation formulation) {
    ImplicitStep<Real> step{};
    step.nx = problem.lattice.dims.x;
    step.ny = problem.lattice.dims.y;
    step.nz = problem.lattice.dims.z;
    step.first = int(placement.first);
    step.group_bits = problem.group_bits;
    step.spacing = vector_of<Real>(problem.lattice.spacing);
    for (std::size_t b = 0; b < 13; ++b) {
        const Direction& direction = directions()[2 * b];
        step.rest_length[b] = listed_length<Real>(problem, direction, formulation);
        step.deficit[b] = Real(rest_spring(problem, direction).deficit);
    }
    for (std::size_t g = 0; g < 3; ++g) step.stiffness[g] = Real(problem.group_stiffness[g]);
    step.motion = make_motion<Real>(problem);
    return step;
}

#define FOR_PRECISION(Real) \
    template ImplicitStep<Real> make_implicit_step(const Problem&, const Placement&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
