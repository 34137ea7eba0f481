// The APIs that backends are written in. A source in each API's folder registers the API (RegisteredApi).
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "backends/device_choice.h"

namespace voxspring {

/// What the harness asks an API before it makes one of its backends.
struct Api {
    std::string name;   ///< as in BackendEntry::api, Capabilities::family and results: "vulkan"
    std::string title;  ///< as users read it: "Vulkan"
    /// The field of a result's context that holds the device's name, such as "gpu". Empty if there is no such
    /// field.
    std::string device_field = {};
    /// Returns the UUID of the graphics card that this process measures, or an empty string if there is none.
    /// Does not throw. Empty function: this API uses no card, or the card that another API names.
    std::function<std::string()> card = {};
    /// Whether several backends of a study may live in one process, unless its rows report start times. For
    /// an API that takes long to open its device in each process.
    bool shares_process = false;
    /// Lists the devices in the API's order. ListedDevice::refusal says why a backend in float32 does not
    /// take a device. Throws Unavailable without a driver. Empty function: users cannot choose a device.
    std::function<std::vector<ListedDevice>()> devices = {};
};

/// Registers an API. One of the API's sources has a static object of this type.
struct RegisteredApi {
    explicit RegisteredApi(Api api);
};

/// Every API of this build, by name.
const std::map<std::string, Api>& apis();

/// The UUID of the graphics card that this process measures, or an empty string if no API names one. Only the
/// first call asks the APIs, so the result stays the same even if the card fails later.
const std::string& measured_card();

/// The option of the command line that selects the device for backends of `api`: --vulkan-device.
std::string device_option(const std::string& api);
/// The name of the environment variable that selects the device for backends of `api`, such as
/// VOXSPRING_VULKAN_DEVICE. Its value is a device's number or a part of its name (devices_to_try()). Child
/// processes inherit the variable.
std::string device_variable(const std::string& api);
/// The value of the environment variable device_variable(`api`), or an empty string if it is not set:
/// backends then take the first usable device.
std::string asked_device(const std::string& api);

}  // namespace voxspring
