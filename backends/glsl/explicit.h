// What the host computes without a device for shaders/compute_explicit.comp (explicit addressing): the bytes
// of lists, and whether they fit.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "backends/glsl/device.h"

namespace voxspring::glsl {

/// Which lists a problem needs beside that of neighbours.
struct ListKind {
    /// Whether springs cannot share the constants of a group (layout::grouped_list_refusal()). The secondary
    /// list then has the stiffness and rest length of each spring.
    bool secondary = false;
    /// Whether a list has the rest offsets of springs that are not of the lattice. Formulations on positions
    /// do not need it.
    bool off_lattice_rest = false;
};
ListKind list_kind(const Problem& problem, Formulation formulation);

/// Bytes of memory that upload() of a backend with explicit addressing takes (BackendEntry::bytes).
std::uint64_t explicit_bytes(const Problem& problem, const Options& options);

/// The name and the bytes of each list, empty lists included.
std::vector<std::pair<const char*, std::uint64_t>> list_bytes(const Problem& problem, const Options& options);

/// Whether shaders reach the lists of `problem` by the addresses of their slots (shaders/lists.glsl): if one
/// list is too large for an array, or the tuning `lists` asks for it. lists_refusal() must accept `problem`.
bool by_address(const Problem& problem, const Options& options, const BufferLimits& limits);

/// An empty string, or why a device cannot hold the lists of a problem.
std::string lists_refusal(const Problem& problem, const Options& options, const BufferLimits& limits);

}  // namespace voxspring::glsl
