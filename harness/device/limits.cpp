#include "harness/device/limits.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "harness/base/text.h"

namespace voxspring {
namespace {

/// Calls `field` with the name and the value, a double or an optional one, of each limit but the bandwidths.
template <class Limits, class Field>
void visit(Limits& limits, const Field& field) {
    field("copy_bytes_per_second", limits.copy_bytes_per_second);
    field("cached_copy_bytes_per_second", limits.cached_copy_bytes_per_second);
    field("cache_bytes", limits.cache_bytes);
    field("launch_seconds", limits.launch_seconds);
    field("grid_barrier_seconds", limits.grid_barrier_seconds);
    field("exchange_seconds", limits.exchange_seconds);
    field("float32_operations_per_second", limits.float32_operations_per_second);
    field("float64_operations_per_second", limits.float64_operations_per_second);
    field("compute_shader_float32_operations_per_second",
          limits.compute_shader_float32_operations_per_second);
}

struct Write {
    nlohmann::json& json;
    void operator()(const char* name, double value) const { json[name] = value; }
    void operator()(const char* name, const std::optional<double>& value) const {
        if (value) json[name] = *value;
    }
};

struct Read {
    const nlohmann::json& json;
    void operator()(const char* name, double& value) const { value = json.at(name); }
    void operator()(const char* name, std::optional<double>& value) const {
        if (json.contains(name)) value = json.at(name).get<double>();
    }
};

}  // namespace

nlohmann::json to_json(const DeviceLimits& limits) {
    nlohmann::json json = nlohmann::json::object();
    visit(limits, Write{json});
    for (const Bandwidth& one : limits.bandwidth) {
        json["bandwidth"].push_back({{"footprint_bytes", one.footprint_bytes},
                                     {"written_share", one.written_share},
                                     {"bytes_per_second", one.bytes_per_second}});
    }
    return json;
}

DeviceLimits device_limits_of(const nlohmann::json& json) {
    DeviceLimits limits;
    visit(limits, Read{json});
    for (const auto& one : json.value("bandwidth", nlohmann::json::array())) {
        limits.bandwidth.push_back(
            {one.at("footprint_bytes"), one.at("written_share"), one.at("bytes_per_second")});
    }
    return limits;
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
