// What the host computes without a device for shaders/compute_implicit.comp (implicit addressing).
#pragma once

#include <cstdint>
#include <string>

#include "backends/backend.h"
#include "backends/layout/blocks.h"

namespace voxspring::glsl {

/// Bytes of memory that upload() of a backend with implicit addressing takes.
std::uint64_t implicit_bytes(const Problem& problem, const Options& options);

/// An empty string, or why work groups cannot cover the lattice.
std::string too_long(const Lattice& lattice, layout::BlockShape shape);

/// Whether subgroups vote on skipping masks (tuning `interior`). With interior=auto they vote in the
/// formulations in which that was faster in OpenGL on an H200 (gl/README.md), but never on a software device:
/// Mesa computes both branches for every subgroup.
bool votes(const Options& options, bool is_software);

}  // namespace voxspring::glsl
