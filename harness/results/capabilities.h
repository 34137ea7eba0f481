// What a backend runs on, as results say it.
#pragma once

#include <nlohmann/json.hpp>

#include "backends/backend.h"

namespace voxspring {

/// An entry of `context.voxspring.backends` (results/schema.json).
nlohmann::json to_json(const Capabilities& capabilities);

/// Back, also from what version 0.1 wrote: it has neither `family` nor `software`, which then follow from the
/// names of API and device. Fields that are missing otherwise are at their defaults.
Capabilities capabilities_of(const nlohmann::json& json);

}  // namespace voxspring
