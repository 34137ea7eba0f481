// Blocks of a lattice (boxes of voxels, each stepped by one thread block), and the argument of the kernels
// that step them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "backends/layout/particles.h"
#include "backends/layout/records/implicit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// Threads per block along x, y, z.
struct BlockShape {
    int x = 1, y = 1, z = 1;
    /// Parses text such as "32x4x2". Missing extents are 1.
    static BlockShape parse(const std::string& text);
    bool operator==(const BlockShape&) const = default;
};

/// Numbers the blocks of a lattice and a frame of one block around them (kernels/resting.h). The number of a
/// block is called its place.
class BlockGrid {
public:
    BlockGrid(const Lattice& lattice, BlockShape shape);
    /// row(), slice(): what to add to a block's place to get that of its neighbour along y, along z.
    /// places(): the number of places.
    std::size_t row() const { return row_; }
    std::size_t slice() const { return slice_; }
    std::size_t places() const { return places_; }
    /// The place of block (x, y, z).
    std::size_t place(int x, int y, int z) const {
        return std::size_t(x + 1) + std::size_t(y + 1) * row_ + std::size_t(z + 1) * slice_;
    }
    std::size_t place_of(const Lattice& lattice, std::uint32_t voxel) const {
        const glm::ivec3 c = lattice.coordinates(voxel);
        return place(c.x / shape_.x, c.y / shape_.y, c.z / shape_.z);
    }

private:
    BlockShape shape_;
    std::size_t row_, slice_, places_;
};

/// Origins of the blocks that hold an active voxel, x fastest.
std::vector<BlockOrigin> list_blocks(const Lattice& lattice, BlockShape shape);
/// The blocks of list_blocks(), or an empty list if every block of the lattice holds an active voxel and
/// fits_launch() is true. Then a launch needs no list: a block's coordinates in the launch give its origin.
std::vector<BlockOrigin> occupied_blocks(const Lattice& lattice, BlockShape shape);
/// Whether one launch with one thread per voxel can cover all blocks of the lattice. CUDA limits the number
/// of blocks along y and z.
bool fits_launch(const Lattice& lattice, BlockShape shape);

/// A split step of a part of a body (CudaBackend::split_steps()) has two parts: first the blocks with
/// particles of its borders, ghosts included (`border`), then the others.
enum class StepPart : std::uint8_t { border, interior };

/// Blocks in two parts: first the blocks with a particle of a border, then all others.
template <class Block>
struct BlockParts {
    std::vector<Block> blocks;
    std::size_t border = 0;  ///< number of blocks in the first part

    std::size_t begin_of(StepPart part) const { return part == StepPart::border ? 0 : border; }
    std::size_t count_of(StepPart part) const {
        return part == StepPart::border ? border : blocks.size() - border;
    }
};

/// The blocks of list_blocks() in two parts. `border`: the particles of the border.
BlockParts<BlockOrigin> part_blocks(const Lattice& lattice, BlockShape shape,
                                    const std::vector<std::uint32_t>& border);
/// The numbers of blocks in two parts, if particles are divided in canonical order into blocks of `block`
/// particles. `border`: the particles of the border.
BlockParts<std::uint32_t> part_blocks(std::size_t particles, unsigned block,
                                      const std::vector<std::uint32_t>& border);

/// The argument of the kernels with implicit addressing, with rest lengths as listed_length() gives them. Its
/// pointers are null: the caller sets them to arrays on the device.
template <class Real>
ImplicitStep<Real> make_implicit_step(const Problem& problem, const Placement& placement,
                                      Formulation formulation);

}  // namespace voxspring::layout
