// The limits of this machine's devices, and the fraction of them that a row reached.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "backends/backend.h"

namespace voxspring {

/// The limits that apply as JSON, with the names of the result's schema; and the reverse.
nlohmann::json to_json(const DeviceLimits& limits);
DeviceLimits device_limits_of(const nlohmann::json& json);

/// The limits of every device that was measured, by Capabilities::limits_of or, where that is empty, by the
/// name of the API.
class MeasuredLimits {
public:
    /// The limits of the device that `capabilities` describes; empty if they could not be measured. `measure`
    /// measures them, on a separate backend, and is called once per name.
    std::optional<DeviceLimits> of(const Capabilities& capabilities,
                                   const std::function<DeviceLimits()>& measure);

    /// By the names above: api, device and every limit that applies, or the reason why there are none.
    nlohmann::json json() const;

private:
    struct Measured {
        std::string api, device;
        std::optional<DeviceLimits> limits;
        std::string why_not;  ///< why there are no limits
    };
    std::map<std::string, Measured> measured_;
};

/// Prints one line per device, and a second one if its fragment shaders reach only a small part of its
/// arithmetic.
void print_limits(const nlohmann::json& limits, std::ostream& out);

}  // namespace voxspring
