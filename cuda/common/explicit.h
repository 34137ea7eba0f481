// Explicit addressing on the device: one thread per particle, with and without a secondary list.
#pragma once

#include <memory>

#include "backends/registry.h"

namespace voxspring::cuda {

/// When a backend carries the secondary list.
enum class Secondary : std::uint8_t { always, where_needed, never };

/// Device memory in bytes.
std::uint64_t explicit_bytes(const Problem& problem, const Options& options, Secondary secondary);
/// A backend that reads positions by the path that the tuning parameter `fetch` names.
std::unique_ptr<Backend> make_explicit(const Options& options, Secondary secondary);

/// Threads per block, the default first.
inline const TuningValues explicit_blocks = {"128", "64", "256", "512"};
/// The layouts of the paper's Figures 6 b and 6 a.
inline const TuningValues list_layouts = {"vertical", "concatenated"};

}  // namespace voxspring::cuda
