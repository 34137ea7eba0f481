// Implicit addressing on the device: neighbours follow from a particle's position in the lattice. One backend
// class serves two kernels: one fetches neighbours from memory, the other from a tile in shared memory.
#pragma once

#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// Describes a backend with implicit addressing. `fetches`: the ways to read positions, the default first;
/// empty: neighbours are read from tiles in shared memory, as wide and high as a block. `blocks`: shapes of
/// blocks, the default first.
BackendEntry implicit_entry(const std::string& name, const std::string& summary, const TuningValues& fetches,
                            const TuningValues& blocks);

/// Shapes of blocks of voxels, with at most 256 threads each.
inline const TuningValues voxel_blocks = {"32x4x2",  "32x8x1",  "64x4x1", "128x2x1",
                                          "128x1x1", "16x16x1", "16x4x4", "8x8x4"};

}  // namespace voxspring::cuda
