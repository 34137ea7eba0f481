#include "harness/device/limits.h"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <type_traits>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "version.h"  // generated

namespace voxspring {
namespace {

/// Calls field(name, value) for each limit except `bandwidth`. The value is a double or an optional double.
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

}  // namespace

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Bandwidth, footprint_bytes, written_share, bytes_per_second)

nlohmann::json to_json(const DeviceLimits& limits) {
    nlohmann::json json = nlohmann::json::object();
    visit(limits, [&](const char* name, const std::optional<double>& value) {
        if (value) json[name] = *value;
    });
    if (!limits.bandwidth.empty()) json["bandwidth"] = limits.bandwidth;
    return json;
}

DeviceLimits device_limits_of(const nlohmann::json& json) {
    DeviceLimits limits;
    visit(limits, [&](const char* name, auto& value) {
        constexpr bool is_required = std::is_same_v<decltype(value), double&>;
        if (is_required || json.contains(name)) value = json.at(name).get<double>();
    });
    limits.bandwidth = json.value("bandwidth", std::vector<Bandwidth>());
    return limits;
}

DeviceLimits best_of(const DeviceLimits& one, const DeviceLimits& other) {
    DeviceLimits best = one;
    const nlohmann::json seen = to_json(other);
    visit(best, [&](const std::string_view name, auto& value) {
        const auto found = seen.find(name);
        if (found == seen.end()) return;
        const double theirs = *found, ours = std::optional<double>(value).value_or(theirs);
        value = name.ends_with("_per_second") || name == "cache_bytes" ? std::max(ours, theirs)
                                                                       : std::min(ours, theirs);
    });
    for (const Bandwidth& theirs : other.bandwidth) {
        const auto ours = std::find_if(best.bandwidth.begin(), best.bandwidth.end(), [&](const auto& own) {
            return own.footprint_bytes == theirs.footprint_bytes && own.written_share == theirs.written_share;
        });
        if (ours == best.bandwidth.end()) {
            best.bandwidth.push_back(theirs);
        } else {
            ours->bytes_per_second = std::max(ours->bytes_per_second, theirs.bytes_per_second);
        }
    }
    return best;
}

namespace {

/// Whether fragment shaders reach less than a quarter of the arithmetic rate of compute shaders. If so, the
/// card runs them on only some of its processors.
bool is_on_a_part(const DeviceLimits& limits) {
    return limits.float32_operations_per_second <
           limits.compute_shader_float32_operations_per_second.value_or(0) / 4;
}

/// The key of a device's limits in the cache on disk: a hash of all that the limits depend on. The number of
/// processors is part of the key, because a thread on each of them measures the host's limits, and because
/// the sizes of the arrays that these threads move are multiples of that number. OMP_NUM_THREADS changes
/// neither.
std::string name_in_cache(const Capabilities& device) {
    return "limits-" + hash_of(json_text({version_commit, device.api, device.device, device.driver,
                                          device.uuid, device.limits_of, omp_get_num_procs()}));
}

}  // namespace

std::optional<BestLimits> best_so_far(const Capabilities& device) {
    const std::optional<std::string> kept = DiskCache().find(name_in_cache(device));
    if (!kept) return std::nullopt;
    const nlohmann::json json = parsed_json(*kept);
    return BestLimits{device_limits_of(json), json.value("processes", 0)};
}

DeviceLimits best_so_far(const Capabilities& device, const DeviceLimits& measured, int processes) {
    const std::optional<BestLimits> known = best_so_far(device);
    DeviceLimits best = known ? best_of(known->limits, measured) : measured;
    nlohmann::json json = to_json(best);
    json["processes"] = processes + (known ? known->processes : 0);
    DiskCache().keep(name_in_cache(device), json_text(json));
    return best;
}

StepBound bound_of(const StepWork& work, Precision precision, const DeviceLimits& own,
                   const std::vector<DeviceLimits>& of_card) {
    StepBound bound;
    const auto add = [&](double seconds, const char* name) {
        bound.sum_seconds += seconds;
        if (bound.longest.limited_by.empty() || seconds > bound.longest.seconds)
            bound.longest = {seconds, name};
    };
    const auto shortest = [&](const StepWork& part, double seconds) {
        for (const DeviceLimits& one : of_card) {
            if (precision == Precision::float32 || one.float64_operations_per_second)
                seconds = std::min(seconds, limit_of(part, one, precision).seconds);
        }
        return seconds;
    };
    StepWork bytes = work, operations{.operations = work.operations, .launches = 0};
    bytes.operations = 0;
    bytes.launches = bytes.exchanges = 0;
    add(work.launches * own.launch_seconds, "launch");
    add(work.exchanges * own.exchange_seconds.value_or(0), "exchange");
    add(shortest(bytes, limit_of(bytes, own, precision).seconds), "bandwidth");
    add(shortest(operations, limit_of(operations, own, precision).seconds), "arithmetic");
    return bound;
}

const std::string& MeasuredLimits::name_of(const Capabilities& capabilities) {
    return capabilities.limits_of.empty() ? capabilities.api : capabilities.limits_of;
}

std::vector<DeviceLimits> MeasuredLimits::on_card_of(const Capabilities& capabilities) const {
    std::vector<DeviceLimits> all;
    const auto own = measured_.find(name_of(capabilities));
    if (own != measured_.end() && own->second.limits && is_on_a_part(*own->second.limits))
        return {*own->second.limits};
    for (const auto& [name, one] : measured_) {
        const bool same =
            capabilities.uuid.empty() ? name == name_of(capabilities) : one.uuid == capabilities.uuid;
        if (same && one.limits) all.push_back(*one.limits);
    }
    return all;
}

void MeasuredLimits::improve_launch(const Capabilities& capabilities, double seconds) {
    const auto known = measured_.find(name_of(capabilities));
    if (known == measured_.end() || !known->second.limits) return;
    DeviceLimits& limits = *known->second.limits;
    if (seconds >= limits.launch_seconds) return;
    limits.launch_seconds = seconds;
    (void)best_so_far(capabilities, limits, 0);
}

std::optional<DeviceLimits> MeasuredLimits::of(const Capabilities& capabilities,
                                               const std::function<DeviceLimits()>& measure) {
    const std::string& of = name_of(capabilities);
    if (const auto known = measured_.find(of); known != measured_.end()) return known->second.limits;
    Measured one{.api = capabilities.api,
                 .device = capabilities.device,
                 .uuid = capabilities.uuid,
                 .limits = {},
                 .why_not = {}};
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
        // Clang 14 cannot capture the structured binding `device`, so the capture has an initializer.
        const auto value = [&limit = device](const char* name) { return limit.value(name, 0.0); };
        out << si(value("copy_bytes_per_second"), "B/s");
        if (value("cache_bytes") > 0) {
            out << ", " << si(value("cached_copy_bytes_per_second"), "B/s") << " in "
                << si(value("cache_bytes"), "B") << " of cache";
        }
        const auto say = [&](const char* text, const char* name, const char* unit) {
            if (value(name) > 0) out << text << si(value(name), unit);
        };
        say(", a launch ", "launch_seconds", "s");
        say(", a grid barrier ", "grid_barrier_seconds", "s");
        say(", an exchange between blocks ", "exchange_seconds", "s");
        const double fragment = value("float32_operations_per_second");
        const double compute = value("compute_shader_float32_operations_per_second");
        out << ", float32 " << si(fragment, "op/s");
        say(", float64 ", "float64_operations_per_second", "op/s");
        say(", compute shaders ", "compute_shader_float32_operations_per_second", "op/s");
        out << " (" << device.at("device").get<std::string>() << ")\n";
        if (fragment < compute / 4) {
            out << "    " << family << " runs fragment shaders on this device at 1/"
                << std::lround(compute / fragment)
                << " of the arithmetic rate of compute shaders: rows of its fragment shaders show a limit of "
                   "this device, not of the API\n";
        }
    }
}

}  // namespace voxspring
