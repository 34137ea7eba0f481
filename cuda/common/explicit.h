// Explicit addressing on the device: a thread for each particle, with and without a secondary list.
#pragma once

#include <memory>

#include "backends/registry.h"

namespace voxspring::cuda {

/// When a backend carries the secondary list.
enum class Secondary : std::uint8_t { always, where_needed, never };

/// Bytes of device memory.
std::uint64_t explicit_bytes(const Problem& problem, const Options& options, Secondary secondary);
/// The backend whose positions come by the path that the tuning parameter `fetch` names.
std::unique_ptr<Backend> make_explicit(const Options& options, Secondary secondary);

/// Threads of a block, the default first.
inline const TuningValues explicit_blocks = {"128", "64", "256", "512"};
/// The paper's Figure 6 b and a.
inline const TuningValues list_layouts = {"vertical", "concatenated"};

}  // namespace voxspring::cuda
