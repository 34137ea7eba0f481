// Explicit addressing on the device: one thread per particle, and a list of its neighbours, with or without a
// secondary list.
#pragma once

#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// When a backend stores the secondary list, which has the stiffness and rest length of each spring.
enum class Secondary : std::uint8_t { always, where_needed, never };

/// Describes a backend with explicit addressing. `fetches`: the ways to read positions, the default first.
BackendEntry explicit_entry(const std::string& name, const std::string& summary, const TuningValues& fetches,
                            Secondary secondary);

}  // namespace voxspring::cuda
