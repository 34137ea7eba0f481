#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>
#include <nlohmann/json.hpp>
#include <ostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "backends/api.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"
#include "backends/registry.h"
#include "harness/base/json.h"
#include "harness/base/progress.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/device/limits.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {
namespace {

/// Whether the backend accepts a spring between particles that are not neighbours on the lattice.
bool leaves_lattice(const Backend& backend) {
    Problem problem = make_lattice_problem({{3, 1, 1}, glm::dvec3(1), {1, 1, 1}}, FACE_BITS);
    problem.springs = {{0, 2, 1, 2}};
    return backend.unsupported(problem).empty();
}

nlohmann::json describe_backend(const BackendEntry& entry) {
    nlohmann::json tuning = nlohmann::json::object();
    for (const auto& [key, values] : entry.tuning) {
        tuning[key] = values.empty() ? nlohmann::json{"auto", "positive integer"} : nlohmann::json(values);
    }
    nlohmann::json described = {{"name", entry.name},
                                {"summary", entry.summary},
                                {"formulations", nlohmann::json::array()},
                                {"precisions", nlohmann::json::array()},
                                {"tuning", tuning}};
    for (const Precision precision : entry.precisions)
        described["precisions"].push_back(to_string(precision));
    for (const Formulation formulation : entry.formulations)
        described["formulations"].push_back(to_string(formulation));
    try {
        const auto backend = BackendSpec::parse(entry.name).make();
        const Capabilities capabilities = backend->capabilities();
        described["available"] = true;
        described["beyond_lattice"] = leaves_lattice(*backend);
        described["api"] = capabilities.api;
        described["uuid"] = capabilities.uuid;
        described["device"] = capabilities.device;
        described["devices"] = capabilities.devices;
        described["driver"] = capabilities.driver;
        described["clock"] = capabilities.clock;
    } catch (const std::runtime_error& error) {
        described["available"] = false;
        described["reason"] = error.what();
    }
    return described;
}

/// The devices of an API, with the reason for each that its backends do not take. Empty if there is no
/// driver: the list of backends says so.
nlohmann::json describe_devices(const Api& api) {
    nlohmann::json described = nlohmann::json::array();
    try {
        for (const ListedDevice& device : api.devices()) {
            described.push_back({{"number", described.size()},
                                 {"name", device.name},
                                 {"kind", to_string(device.kind)},
                                 {"available", device.refusal.empty()}});
            if (!device.refusal.empty()) described.back()["reason"] = device.refusal;
        }
    } catch (const Unavailable&) {
        described = nlohmann::json::array();
    }
    return described;
}

nlohmann::json everything() {
    nlohmann::json backends = nlohmann::json::array(), scenes = backends, studies = backends;
    for (const auto& [name, entry] : registry()) backends.push_back(describe_backend(entry));
    for (const auto& [name, reason] : left_out())
        backends.push_back(
            {{"name", name}, {"available", false}, {"reason", "not in this build: " + reason}});
    for (const auto& [name, description] : builtin_scenes())
        scenes.push_back({{"name", name}, {"description", description}});
    for (const auto& [name, description] : builtin_studies())
        studies.push_back({{"name", name}, {"description", description}});
    nlohmann::json all = {{"backends", backends}, {"scenes", scenes}, {"studies", studies}};
    for (const auto& [name, api] : apis()) {
        if (api.devices) all[name + "_devices"] = describe_devices(api);
    }
    return all;
}

std::string text(const nlohmann::json& object, const char* key) { return object.at(key); }

/// The strings of a list, joined: "a|b".
std::string alternatives(const nlohmann::json& list) {
    return fmt::format("{}", fmt::join(list.get<std::vector<std::string>>(), "|"));
}

void print_backend(const nlohmann::json& backend, std::ostream& out) {
    out << fmt::format("  {}\n      {}\n      on {}, {}\n      precision={} formulation={}",
                       text(backend, "name"), text(backend, "summary"), text(backend, "api"),
                       text(backend, "device"), alternatives(backend["precisions"]),
                       alternatives(backend["formulations"]));
    for (const auto& [key, list] : backend["tuning"].items()) out << " " << key << "=" << alternatives(list);
    out << "\n      sutures can join "
        << (backend["beyond_lattice"].get<bool>() ? "any two particles" : "neighbours on the lattice only")
        << "\n";
}

/// Prints the available backends, then the names of those that are not available, grouped by reason.
void print_backends(const nlohmann::json& backends, std::ostream& out) {
    std::map<std::string, std::vector<std::string>> absent;
    for (const auto& backend : backends) {
        if (backend["available"].get<bool>()) {
            print_backend(backend, out);
        } else {
            absent[backend["reason"]].push_back(backend["name"]);
        }
    }
    for (const auto& [reason, names] : absent)
        out << "  not available: " << joined(names) << "\n      " << reason << "\n";
}

void print_devices(const Api& api, const nlohmann::json& devices, std::ostream& out) {
    if (!devices.empty()) out << api.title << " devices, for --" << api.name << "-device\n";
    for (const auto& device : devices) {
        out << "  " << device["number"].get<int>() << " " << text(device, "name") << ", "
            << text(device, "kind") << (device["available"].get<bool>() ? "" : ": " + text(device, "reason"))
            << "\n";
    }
}

}  // namespace

void list_everything(bool json, std::ostream& out) {
    const nlohmann::json all = everything();
    if (json) {
        out << json_text(all, 2) << "\n";
        return;
    }
    out << "Backends\n";
    print_backends(all["backends"], out);
    for (const auto& [name, api] : apis()) {
        if (api.devices) print_devices(api, all[name + "_devices"], out);
    }
    for (const auto& [heading, key] : {std::pair{"Scenes", "scenes"}, std::pair{"Studies", "studies"}}) {
        out << heading << "\n";
        for (const auto& item : all[key])
            out << "  " << text(item, "name") << ": " << text(item, "description") << "\n";
    }
}

void list_limits(bool json, std::ostream& out) {
    MeasuredLimits limits;
    Activity activity;
    for (const auto& [name, entry] : registry()) {
        const BackendSpec spec = BackendSpec::parse(name);
        activity.begin("measuring what the device of " + name + " can do");
        try {
            const std::unique_ptr<Backend> backend = spec.make();
            if (backend->limits() != nullptr)
                limits.of(backend->capabilities(), [&] { return spec.make()->limits()->measure_limits(); });
        } catch (const std::runtime_error&) {
            // The backend is not available, as `voxspring list` says, or its device failed.
        }
    }
    activity.end();
    if (json) {
        out << json_text(limits.json(), 2) << "\n";
    } else {
        print_limits(limits.json(), out);
    }
}

}  // namespace voxspring
