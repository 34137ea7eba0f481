#include "backends/limits.h"

#include "backends/backend.h"

namespace voxspring {

StepLimit limit_of(const StepWork& work, const DeviceLimits& limits, Precision precision) {
    const auto bytes = double(work.bytes);
    const double bytes_per_second =
        bytes <= limits.cache_bytes ? limits.cached_copy_bytes_per_second : limits.copy_bytes_per_second;
    const double operations_per_second = precision == Precision::float32
                                             ? limits.float32_operations_per_second
                                             : limits.float64_operations_per_second.value();
    StepLimit limit{work.launches * limits.launch_seconds, "launch"};
    const auto lengthen = [&](double seconds, const char* by) {
        if (seconds > limit.seconds) limit = {seconds, by};
    };
    lengthen(work.exchanges * limits.exchange_seconds.value_or(0), "exchange");
    lengthen(bytes / bytes_per_second, "bandwidth");
    lengthen(double(work.operations) / operations_per_second, "arithmetic");
    return limit;
}

}  // namespace voxspring
