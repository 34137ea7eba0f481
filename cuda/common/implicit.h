// Implicit addressing on the device. One backend serves the kernel that fetches neighbours from memory and
// the kernel that fetches them from a tile.
#pragma once

#include <memory>
#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// Bytes of device memory, the same for both kernels.
std::uint64_t implicit_bytes(const Problem& problem, const Options& options);

/// The backend whose positions come by the path that the tuning parameter `fetch` names.
std::unique_ptr<Backend> make_implicit(const Options& options);
/// The backend that fills tiles as wide and high as a block.
std::unique_ptr<Backend> make_tiled(const Options& options);

/// Shapes of at most 256 threads, the default first.
inline const TuningValues implicit_blocks = {"32x4x2",  "32x8x1", "64x4x1", "128x2x1",
                                             "128x1x1", "16x4x4", "8x8x4"};
/// Registers of a thread in float32, half of what it has in float64. All threads of a small lattice run at
/// once, and a step takes as long as one thread waits for memory: with many registers it fetches all
/// neighbours of a group at once. On a large lattice other threads run meanwhile, and few registers make room
/// for more of them. `auto` decides by the lattice's size and the formulation.
inline const TuningValues implicit_registers = {"auto", "32", "40", "48", "64", "128"};
/// What becomes of blocks at rest (resting.h).
inline const TuningValues implicit_rest = {"auto", "step", "skip", "flush"};
/// Whether a warp all of whose particles have all neighbours leaves out the masks (`vote`). `auto` decides by
/// the lattice's size.
inline const TuningValues implicit_interior = {"auto", "mask", "vote"};

/// Which blocks of voxels are launched: those with a particle, or all, a thread a voxel, active or not, as in
/// the paper.
inline const TuningValues implicit_launched = {"occupied", "all"};

}  // namespace voxspring::cuda
