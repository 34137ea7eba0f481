#include "backends/limits.h"

#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <vector>

#include "backends/backend.h"

namespace voxspring {
namespace {

/// The least seconds per byte for each Bandwidth::written_share, at the largest measured footprint that is no
/// larger than `footprint_bytes` and at all larger ones.
std::map<double, double> seconds_per_byte(const std::vector<Bandwidth>& table, double footprint_bytes) {
    double from = std::numeric_limits<double>::infinity();
    for (const Bandwidth& one : table) from = std::min(from, one.footprint_bytes);
    for (const Bandwidth& one : table) {
        if (one.footprint_bytes <= footprint_bytes) from = std::max(from, one.footprint_bytes);
    }
    std::map<double, double> seconds;
    for (const Bandwidth& one : table) {
        if (one.footprint_bytes < from) continue;
        const auto [at, added] = seconds.try_emplace(one.written_share, 1 / one.bytes_per_second);
        at->second = std::min(at->second, 1 / one.bytes_per_second);
    }
    return seconds;
}

}  // namespace

double bytes_per_second_of(const StepWork& work, const DeviceLimits& limits) {
    if (limits.bandwidth.empty()) {
        return double(work.footprint_bytes) <= limits.cache_bytes ? limits.cached_copy_bytes_per_second
                                                                  : limits.copy_bytes_per_second;
    }
    const auto seconds = seconds_per_byte(limits.bandwidth, double(work.footprint_bytes));
    const double share = work.bytes == 0 ? 0 : double(work.written_bytes) / double(work.bytes);
    const auto above = seconds.lower_bound(share);
    if (above == seconds.end()) return 1 / seconds.rbegin()->second;
    if (above == seconds.begin()) return 1 / above->second;
    const auto below = std::prev(above);
    const double part = (share - below->first) / (above->first - below->first);
    return 1 / std::lerp(below->second, above->second, part);
}

StepLimit limit_of(const StepWork& work, const DeviceLimits& limits, Precision precision) {
    const auto bytes = double(work.bytes);
    const double operations_per_second = precision == Precision::float32
                                             ? limits.float32_operations_per_second
                                             : limits.float64_operations_per_second.value();
    StepLimit limit{work.launches * limits.launch_seconds, "launch"};
    const auto lengthen = [&](double seconds, const char* by) {
        if (seconds > limit.seconds) limit = {seconds, by};
    };
    lengthen(work.exchanges * limits.exchange_seconds.value_or(0), "exchange");
    lengthen(bytes / bytes_per_second_of(work, limits), "bandwidth");
    lengthen(double(work.operations) / operations_per_second, "arithmetic");
    return limit;
}

}  // namespace voxspring
