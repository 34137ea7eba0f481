#include "harness/results/capabilities.h"

#include <array>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "harness/base/json.h"

namespace voxspring {
namespace {

struct FamilyName {
    ApiFamily family;
    const char* name;
    const char* api;  ///< the prefix of the names of its versions
};
constexpr std::array family_names = {
    FamilyName{ApiFamily::cpu, "cpu", "CPU"}, FamilyName{ApiFamily::vulkan, "vulkan", "Vulkan"},
    FamilyName{ApiFamily::opengl, "opengl", "OpenGL"}, FamilyName{ApiFamily::cuda, "cuda", "CUDA"}};

std::string name_of(ApiFamily family) {
    for (const FamilyName& known : family_names) {
        if (known.family == family) return known.name;
    }
    return {};
}

ApiFamily family_of(const nlohmann::json& json, const std::string& api) {
    const std::string name = json.value("family", "");
    for (const FamilyName& known : family_names) {
        if (name.empty() ? api.starts_with(known.api) : name == known.name) return known.family;
    }
    return ApiFamily::cpu;
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
            {"family", name_of(capabilities.family)},
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
            .family = family_of(json, api),
            .is_software = json.value("software", device.ends_with(", software")),
            .limits_of = json.value("limits_of", ""),
            .has_borders = json.value("borders", false),
            .border_ways = json.value("border_ways", std::vector<std::string>()),
            .devices = json.value("devices", 1)};
}

}  // namespace voxspring
