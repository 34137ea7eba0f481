#include "harness/results/capabilities.h"

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <string>

#include "harness/base/json.h"

namespace voxspring {
namespace {

/// The family of an entry that has none: the first word of its API, such as "opengl" for "OpenGL 4.5 core".
std::string family_of(const std::string& api) {
    std::string family = api.substr(0, api.find(' '));
    std::transform(family.begin(), family.end(), family.begin(),
                   [](unsigned char letter) { return char(std::tolower(letter)); });
    return family;
}

}  // namespace

nlohmann::json to_json(const Capabilities& capabilities) {
    // These strings come from the driver, and may hold any bytes.
    return {{"api", utf8_text(capabilities.api)},
            {"device", utf8_text(capabilities.device)},
            {"driver", utf8_text(capabilities.driver)},
            {"uuid", capabilities.uuid},
            {"clock", capabilities.clock},
            {"deterministic", capabilities.deterministic},
            {"highest_mhz", capabilities.highest_mhz},
            {"kernel_compiler", capabilities.kernel_compiler},
            {"family", capabilities.family},
            {"software", capabilities.is_software},
            {"limits_of", capabilities.limits_of},
            {"borders", capabilities.has_borders},
            {"border_ways", capabilities.border_ways},
            {"devices", capabilities.devices}};
}

Capabilities capabilities_of(const nlohmann::json& json) {
    const std::string api = json.value("api", ""), device = json.value("device", "");
    return {.api = api,
            .device = device,
            .driver = json.value("driver", ""),
            .uuid = json.value("uuid", ""),
            .clock = json.value("clock", ""),
            .deterministic = json.value("deterministic", true),
            .highest_mhz = json.value("highest_mhz", std::map<std::string, int>()),
            .kernel_compiler = json.value("kernel_compiler", ""),
            .family = json.value("family", family_of(api)),
            .is_software = json.value("software", device.ends_with(", software")),
            .limits_of = json.value("limits_of", ""),
            .has_borders = json.value("borders", false),
            .border_ways = json.value("border_ways", std::vector<std::string>()),
            .devices = json.value("devices", 1)};
}

}  // namespace voxspring
