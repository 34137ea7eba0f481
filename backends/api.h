// The APIs that backends are written in. Each registers itself in a source of its folder; nothing else names
// it.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "backends/device_choice.h"

namespace voxspring {

/// What the harness asks an API before it makes one of its backends.
struct Api {
    std::string name;   ///< "vulkan": BackendEntry::api, Capabilities::family and `family` in results
    std::string title;  ///< "Vulkan"
    /// The field of a result's context that holds the device's name, such as "gpu". Empty: no field does.
    std::string device_field = {};
    /// The UUID of the card that this process measures, or an empty string if there is none. Does not throw.
    /// Empty function: another API decides which card that is, and this one follows.
    std::function<std::string()> card = {};
    /// The devices in the API's order, each with the reason why a backend in float32 does not take it. Throws
    /// Unavailable without a driver. Empty function: users cannot choose between its devices.
    std::function<std::vector<ListedDevice>()> devices = {};
};

/// A static object of this type in one of the API's sources registers it.
struct RegisteredApi {
    explicit RegisteredApi(Api api);
};

/// Every API of this build, by name.
const std::map<std::string, Api>& apis();

/// UUID of the card that this process measures, or an empty string if no API knows one. The APIs are asked
/// only in the first call, so the result stays the same even if the card fails later.
const std::string& measured_card();

/// The name of the environment variable that selects the device for backends of `api`, such as
/// VOXSPRING_VULKAN_DEVICE. Its value is the argument `asked` of devices_to_try(). Processes that this one
/// starts inherit it.
std::string device_variable(const std::string& api);
/// The value of device_variable(`api`). Empty: backends take the first usable device.
std::string asked_device(const std::string& api);

}  // namespace voxspring
