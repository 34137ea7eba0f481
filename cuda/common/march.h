// The march along z (kernels/march.h): the fast way through a large lattice of one material.
#pragma once

#include <memory>

#include "backends/layout/march_layout.h"
#include "backends/registry.h"
#include "cuda/device/compiler.h"

namespace voxspring::cuda {

/// Device memory, at most.
std::uint64_t march_bytes(const Problem& problem, const Options& options);

std::unique_ptr<Backend> make_march(const Options& options);

/// The kernel for a scene.
KernelSource march_source(const Problem& problem, Formulation formulation, const MarchTile& tile,
                          Precision precision);

/// Tiles by their width and height in particles, the default first. auto: best_march_tile().
inline const TuningValues march_tiles = {"auto",  "32x20", "64x4",   "64x8",   "64x16", "64x20",
                                         "64x24", "128x8", "128x16", "128x20", "128x24"};

}  // namespace voxspring::cuda
