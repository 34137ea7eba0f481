// What is known of explicit addressing in a compute shader (shaders/compute_explicit.comp) without a device:
// its lists, and whether they fit.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "backends/glsl/device.h"

namespace voxspring::glsl {

/// Which lists a problem needs.
struct ListKind {
    /// Springs that differ within a group have their stiffness and rest length in the secondary list.
    bool secondary = false;
    /// Another list says how springs beyond the lattice lie at rest, if the formulation needs that.
    bool off_lattice_rest = false;
};
ListKind list_kind(const Problem& problem, Formulation formulation);

/// Bytes of memory that upload() of a backend with explicit addressing takes (BackendEntry::bytes).
std::uint64_t explicit_bytes(const Problem& problem, const Options& options);

/// Bytes of each list by its name, empty lists included.
std::vector<std::pair<const char*, std::uint64_t>> list_bytes(const Problem& problem, const Options& options);

/// Whether shaders reach the lists of a problem by the addresses of their slots (shaders/lists.glsl): if one
/// of them is too large for an array and the device has addresses, or if the tuning asks for it (`lists`).
bool by_address(const Problem& problem, const Options& options, const BufferLimits& limits);

/// Empty, or why a device cannot hold the lists of a problem.
std::string lists_refusal(const Problem& problem, const Options& options, const BufferLimits& limits);

}  // namespace voxspring::glsl
