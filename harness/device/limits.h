// The measured limits of this machine's devices (bandwidth, arithmetic rate, launch time), and the shortest
// time of a step that follows from them.
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

/// Writes limits as a JSON object with the keys of results/schema.json. Limits that a device does not have
/// are left out. device_limits_of() reads such an object.
nlohmann::json to_json(const DeviceLimits& limits);
DeviceLimits device_limits_of(const nlohmann::json& json);

/// For each limit the better of the two values that two measurements of a device gave.
DeviceLimits best_of(const DeviceLimits& one, const DeviceLimits& other);

/// The best limits of a device that the processes of this commit have measured with this number of
/// processors.
struct BestLimits {
    DeviceLimits limits;
    int processes = 0;  ///< how many have measured all of them
};
/// The first function adds `measured` to the best limits; the second returns no value if nothing was measured
/// yet. They are kept in the user's cache, since a processor's rates, and launch times that depend on the
/// host, differ between processes by tens of percent. `processes` of them measured all of `measured`; 0 if
/// only some of it was measured.
DeviceLimits best_so_far(const Capabilities& device, const DeviceLimits& measured, int processes = 1);
std::optional<BestLimits> best_so_far(const Capabilities& device);

/// Bounds on the time of a step, from its shortest times for launches, exchanges between blocks, memory
/// traffic and arithmetic. `longest` is the longest of these: no step is faster. `sum_seconds` is their sum:
/// the time of a step in which none of them overlap.
struct StepBound {
    StepLimit longest;
    double sum_seconds = 0;
};
/// Computes the bounds of a step with `work`. Times for launches and exchanges follow from `own`, the limits
/// of the step's API. Times for memory traffic and arithmetic are the shortest that follow from `own` or from
/// `of_card`, the limits of all APIs on the same card. So backends with the same `of_card` have the same
/// rates.
StepBound bound_of(const StepWork& work, Precision precision, const DeviceLimits& own,
                   const std::vector<DeviceLimits>& of_card);

/// The limits of all devices that were measured. The key of a device is Capabilities::limits_of or, if that
/// is empty, the name of the API.
class MeasuredLimits {
public:
    /// The limits of the device that `capabilities` describes; empty if they could not be measured. The first
    /// call for a device calls `measure`, which has to measure the limits on a separate backend.
    std::optional<DeviceLimits> of(const Capabilities& capabilities,
                                   const std::function<DeviceLimits()>& measure);

    /// The limits of all APIs that were measured on the card of `capabilities`. If the device has no UUID, or
    /// if the API's fragment shaders run on a small part of the card, only the limits of that API.
    std::vector<DeviceLimits> on_card_of(const Capabilities& capabilities) const;
    /// If `seconds`, a launch time that another process has measured, is shorter than the launch time of the
    /// device, replaces it, also in the user's cache.
    void improve_launch(const Capabilities& capabilities, double seconds);

    /// A JSON object with the key of each device. The value is an object with `api`, `device` and the limits
    /// of the device or, if it could not be measured, the reason as text.
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

/// Prints one line per device. A second line follows if its fragment shaders reach less than a quarter of the
/// arithmetic rate of its compute shaders.
void print_limits(const nlohmann::json& limits, std::ostream& out);

}  // namespace voxspring
