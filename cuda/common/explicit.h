// Explicit addressing on the device: one thread per particle, with and without a secondary list.
#pragma once

#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// When a backend carries the secondary list.
enum class Secondary : std::uint8_t { always, where_needed, never };

/// A strategy of this kind. `fetches`: the paths by which it can read positions, the default first.
BackendEntry explicit_entry(const std::string& name, const std::string& summary, const TuningValues& fetches,
                            Secondary secondary);

}  // namespace voxspring::cuda
