// Capabilities of a backend as results store them.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "backends/backend.h"

namespace voxspring {

/// Capabilities as an entry of `context.voxspring.backends` (results/schema.json).
nlohmann::json to_json(const Capabilities& capabilities);

/// Reads such an entry. An entry that version 0.1 wrote has neither `family` nor `software`: these then
/// follow from the names of the API and the device. Other missing fields get their defaults.
Capabilities capabilities_of(const nlohmann::json& json);

}  // namespace voxspring
