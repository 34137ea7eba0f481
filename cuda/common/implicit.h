// Implicit addressing on the device. One backend serves both kernels: one fetches neighbours from memory, the
// other from a tile in shared memory.
#pragma once

#include <memory>
#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// Device memory in bytes; both kernels take the same.
std::uint64_t implicit_bytes(const Problem& problem, const Options& options);

/// A backend that reads positions by the path that the tuning parameter `fetch` names.
std::unique_ptr<Backend> make_implicit(const Options& options);
/// A backend whose tiles are as wide and high as a block.
std::unique_ptr<Backend> make_tiled(const Options& options);

/// Shapes of at most 256 threads, the default first.
inline const TuningValues implicit_blocks = {"32x4x2",  "32x8x1", "64x4x1", "128x2x1",
                                             "128x1x1", "16x4x4", "8x8x4"};
/// Registers per thread in float32; in float64 a thread has twice as many. All threads of a small lattice run
/// at once, and a step takes as long as one thread waits for memory: with many registers it fetches all
/// neighbours of a group at once. On a large lattice other threads run meanwhile, and few registers make room
/// for more of them. `auto` decides by the lattice's size and the formulation.
inline const TuningValues implicit_registers = {"auto", "32", "40", "48", "64", "128"};
/// What a step does with blocks at rest (resting.h).
inline const TuningValues implicit_rest = {"auto", "step", "skip", "flush"};
/// Whether a warp skips the masks if all its particles have all neighbours (`vote`). `auto` decides by the
/// lattice's size.
inline const TuningValues implicit_interior = {"auto", "mask", "vote"};

/// Which blocks of voxels are launched: those with a particle, or all, with one thread per voxel, active or
/// not, as in the paper.
inline const TuningValues implicit_launched = {"occupied", "all"};

}  // namespace voxspring::cuda
