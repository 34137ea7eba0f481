// The limits of this machine's devices, and the shortest time of a step that follows from them.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "backends/backend.h"

namespace voxspring {

/// Writes limits as a JSON object, with the names that the schema of results has. Limits that a device does
/// not have are left out. device_limits_of() reads such an object.
nlohmann::json to_json(const DeviceLimits& limits);
DeviceLimits device_limits_of(const nlohmann::json& json);

/// The better value of each limit from two measurements of a device.
DeviceLimits best_of(const DeviceLimits& one, const DeviceLimits& other);

/// The best limits of a device that any process of this build has measured, including `measured`. They are
/// kept in the user's cache, because a processor's rates and the launch times that depend on the host differ
/// between processes by tens of percent. The second function returns nothing if nothing was measured yet.
DeviceLimits best_so_far(const Capabilities& device, const DeviceLimits& measured);
std::optional<DeviceLimits> best_so_far(const Capabilities& device);

/// Lower bounds on the time of a step: the longest of the times for launches, exchanges, memory traffic and
/// arithmetic, and the sum of these times.
struct StepBound {
    StepLimit longest;
    double sum_seconds = 0;
};
/// Computes the bounds for `work`. Times for launches and exchanges come from `own`, the limits of the step's
/// API. Times for memory traffic and arithmetic are the shortest by `own` and by `of_card`, the limits of all
/// APIs on the same card, so that all rows of a card are compared with the same limit.
StepBound bound_of(const StepWork& work, Precision precision, const DeviceLimits& own,
                   const std::vector<DeviceLimits>& of_card);

/// The limits of each measured device. The key is Capabilities::limits_of or, if empty, the API's name.
class MeasuredLimits {
public:
    /// The limits of the device that `capabilities` describes; empty if they could not be measured. Calls
    /// `measure`, which measures them on a separate backend, unless that was done.
    std::optional<DeviceLimits> of(const Capabilities& capabilities,
                                   const std::function<DeviceLimits()>& measure);

    /// The limits of all APIs that were measured on the card of `capabilities`. For a device without a UUID,
    /// and for an API whose fragment shaders run on a small part of the card, only the limits of that API.
    std::vector<DeviceLimits> on_card_of(const Capabilities& capabilities) const;
    /// Lowers the launch time of a device to `seconds`, measured by another process, if that is shorter.
    void improve_launch(const Capabilities& capabilities, double seconds);

    /// A JSON object with this class's keys. Each value is an object with `api`, `device` and every limit
    /// that applies, or the text why there are none.
    nlohmann::json json() const;

private:
    static const std::string& name_of(const Capabilities& capabilities);

    struct Measured {
        std::string api, device, uuid;
        std::optional<DeviceLimits> limits;
        std::string why_not;  ///< why there are no limits; empty if there are
    };
    std::map<std::string, Measured> measured_;
};

/// Prints one line per device, and a second one if its fragment shaders reach only a small part of its
/// arithmetic.
void print_limits(const nlohmann::json& limits, std::ostream& out);

}  // namespace voxspring
