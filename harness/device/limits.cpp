#include "harness/device/limits.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "harness/base/text.h"

namespace voxspring {
namespace {}  // namespace

nlohmann::json to_json(const DeviceLimits& limits) {
    nlohmann::json all = {{"copy_bytes_per_second", limits.copy_bytes_per_second},
                          {"cached_copy_bytes_per_second", limits.cached_copy_bytes_per_second},
                          {"cache_bytes", limits.cache_bytes},
                          {"launch_seconds", limits.launch_seconds},
                          {"float32_operations_per_second", limits.float32_operations_per_second}};
    const auto add = [&](const char* name, const std::optional<double>& value) {
        if (value) all[name] = *value;
    };
    for (const Bandwidth& one : limits.bandwidth) {
        all["bandwidth"].push_back({{"footprint_bytes", one.footprint_bytes},
                                    {"written_share", one.written_share},
                                    {"bytes_per_second", one.bytes_per_second}});
    }
    add("grid_barrier_seconds", limits.grid_barrier_seconds);
    add("exchange_seconds", limits.exchange_seconds);
    add("float64_operations_per_second", limits.float64_operations_per_second);
    add("compute_shader_float32_operations_per_second", limits.compute_shader_float32_operations_per_second);
    return all;
}

DeviceLimits device_limits_of(const nlohmann::json& json) {
    const auto optional = [&](const char* name) {
        return json.contains(name) ? std::optional(json.at(name).get<double>()) : std::nullopt;
    };
    std::vector<Bandwidth> bandwidth;
    for (const auto& one : json.value("bandwidth", nlohmann::json::array()))
        bandwidth.push_back({one.at("footprint_bytes"), one.at("written_share"), one.at("bytes_per_second")});
    return {.bandwidth = bandwidth,
            .copy_bytes_per_second = json.at("copy_bytes_per_second"),
            .cached_copy_bytes_per_second = json.at("cached_copy_bytes_per_second"),
            .cache_bytes = json.at("cache_bytes"),
            .launch_seconds = json.at("launch_seconds"),
            .grid_barrier_seconds = optional("grid_barrier_seconds"),
            .exchange_seconds = optional("exchange_seconds"),
            .float32_operations_per_second = json.at("float32_operations_per_second"),
            .float64_operations_per_second = optional("float64_operations_per_second"),
            .compute_shader_float32_operations_per_second =
                optional("compute_shader_float32_operations_per_second")};
}

std::optional<DeviceLimits> MeasuredLimits::of(const Capabilities& capabilities,
                                               const std::function<DeviceLimits()>& measure) {
    const std::string& of = capabilities.limits_of.empty() ? capabilities.api : capabilities.limits_of;
    if (const auto known = measured_.find(of); known != measured_.end()) return known->second.limits;
    Measured one{.api = capabilities.api, .device = capabilities.device, .limits = {}, .why_not = {}};
    try {
        one.limits = measure();
    } catch (const Unavailable& absent) {
        one.why_not = absent.what();
    } catch (const DeviceError& error) {
        one.why_not = error.what();
    }
    return measured_.emplace(of, std::move(one)).first->second.limits;
}

nlohmann::json MeasuredLimits::json() const {
    nlohmann::json all = nlohmann::json::object();
    for (const auto& [name, one] : measured_) {
        all[name] = one.limits ? to_json(*one.limits) : nlohmann::json(one.why_not);
        if (!one.limits) continue;
        all[name]["api"] = one.api;
        all[name]["device"] = one.device;
    }
    return all;
}

nlohmann::json limit_fields(const std::optional<StepLimit>& limit, std::optional<double> step_seconds) {
    nlohmann::json fields = {
        {"limit_seconds", nullptr}, {"limited_by", nullptr}, {"fraction_of_limit", nullptr}};
    if (!limit) return fields;
    fields["limit_seconds"] = limit->seconds;
    fields["limited_by"] = limit->limited_by;
    if (step_seconds && *step_seconds > 0) fields["fraction_of_limit"] = limit->seconds / *step_seconds;
    return fields;
}

void print_limits(const nlohmann::json& limits, std::ostream& out) {
    for (const auto& [family, device] : limits.items()) {
        out << "limits of " << family << ": ";
        if (device.is_string()) {
            out << "not measured: " << device.get<std::string>() << "\n";
            continue;
        }
        // Clang 14 cannot capture a structured binding, hence the initializer.
        const auto value = [&limit = device](const char* name) { return limit.value(name, 0.0); };
        out << si(value("copy_bytes_per_second"), "B/s");
        if (value("cache_bytes") > 0) {
            out << ", " << si(value("cached_copy_bytes_per_second"), "B/s") << " in "
                << si(value("cache_bytes"), "B") << " of cache";
        }
        if (value("launch_seconds") > 0) out << ", a launch " << si(value("launch_seconds"), "s");
        if (value("grid_barrier_seconds") > 0)
            out << ", a grid barrier " << si(value("grid_barrier_seconds"), "s");
        if (value("exchange_seconds") > 0)
            out << ", an exchange between blocks " << si(value("exchange_seconds"), "s");
        const double fragment = value("float32_operations_per_second");
        const double compute = value("compute_shader_float32_operations_per_second");
        out << ", float32 " << si(fragment, "op/s");
        if (value("float64_operations_per_second") > 0)
            out << ", float64 " << si(value("float64_operations_per_second"), "op/s");
        if (compute > 0) out << ", compute shaders " << si(compute, "op/s");
        out << " (" << device.at("device").get<std::string>() << ")\n";
        if (fragment < compute / 4) {
            out << "    " << family << " runs fragment shaders on this device with 1/"
                << std::lround(compute / fragment)
                << " of the arithmetic of compute shaders: its rows say what that part of the device can "
                   "do, not what the API can\n";
        }
    }
}

}  // namespace voxspring
