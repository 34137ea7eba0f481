// What the devices of this machine can do at best, and what fraction of it a row reached.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "backends/backend.h"

namespace voxspring {

/// The limits that apply, by the names of the result's schema, and back.
nlohmann::json to_json(const DeviceLimits& limits);
DeviceLimits device_limits_of(const nlohmann::json& json);

/// The limits of every device that was measured, by Capabilities::limits_of or, where that is empty, by the
/// name of the API.
class MeasuredLimits {
public:
    /// Those of the device that `capabilities` describe, which `measure` measures on a backend of its own;
    /// nothing where that failed. What has one name is measured once.
    std::optional<DeviceLimits> of(const Capabilities& capabilities,
                                   const std::function<DeviceLimits()>& measure);

    /// By the same names: api, device and every limit that applies, or the reason why there are none.
    const nlohmann::json& json() const { return json_; }

private:
    std::map<std::string, std::optional<DeviceLimits>> limits_;
    nlohmann::json json_ = nlohmann::json::object();
};

/// What a row says of its limit: limit_seconds, limited_by and, where `step_seconds` is a time,
/// fraction_of_limit; null where unknown.
nlohmann::json limit_fields(const std::optional<StepLimit>& limit, std::optional<double> step_seconds);

/// A line a device and, where its fragment shaders have a small part of its arithmetic, one that says so.
void print_limits(const nlohmann::json& limits, std::ostream& out);

}  // namespace voxspring
