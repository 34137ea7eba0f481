// How cpu_parallel lays out the lattice in memory.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>

#include "backends/cpu/array.h"
#include "backends/cpu/kernel.h"

namespace voxspring::cpu_parallel {

/// The lattice in memory. Each row is padded to whole blocks of block_size elements. Before the lattice and
/// after it lies a guard, at least as long as the distance of the farthest neighbour. So a SIMD register can
/// be loaded with the neighbours of any block.
template <class T>
struct PaddedGrid {
    glm::ivec3 dims;
    std::ptrdiff_t row, slice, guard;

    explicit PaddedGrid(glm::ivec3 d)
        : dims(d),
          row((d.x + block_size<T> - 1) / block_size<T> * block_size<T>),
          slice(row * d.y),
          guard(slice + row + block_size<T>) {}

    std::ptrdiff_t size() const { return guard + slice * dims.z + guard; }
    std::ptrdiff_t element(glm::ivec3 c) const { return guard + slice * c.z + row * c.y + c.x; }
    /// Blocks per row, rows per slice, and slices.
    glm::ivec3 blocks() const { return {int(row / block_size<T>), dims.y, dims.z}; }
    std::ptrdiff_t density_guard() const { return row + block_size<T>; }
    /// Elements for the force densities of one direction in one slice: a guard, the slice, and a guard.
    std::ptrdiff_t densities() const { return density_guard() + slice + density_guard(); }
};

}  // namespace voxspring::cpu_parallel
