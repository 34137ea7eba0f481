// What a device can do at best, what one step needs at least, and so how fast a step could be.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>

namespace voxspring {

enum class Precision : std::uint8_t;

/// What simple programs reach on a device that do one thing each, in the kind of program that its backends
/// run: CUDA kernels, fragment shaders, SIMD code on all cores.
struct DeviceLimits {
    /// Bytes read and written by a pass that reads two arrays and overwrites one, as a step does, each far
    /// larger than any cache.
    double copy_bytes_per_second = 0;
    /// The same where the arrays lie in the last-level cache; 0 where its size is unknown.
    double cached_copy_bytes_per_second = 0;
    double cache_bytes = 0;  ///< size of the last-level cache; 0: unknown
    /// From one empty step to the next, which waits for it: a kernel in a CUDA graph, a draw of one fragment;
    /// 0 on the CPU, where a step is a function call.
    double launch_seconds = 0;
    /// A barrier across the grid of a cooperative launch, one block an SM; nothing where there is none.
    std::optional<double> grid_barrier_seconds;
    /// From one point that blocks of such a launch send to their neighbours, one block an SM, to the next,
    /// which waits for it: through the cache that they share, without a barrier; nothing where there is no
    /// way.
    std::optional<double> exchange_seconds;
    /// Of independent multiply-adds, each counted as one operation.
    double float32_operations_per_second = 0;
    std::optional<double> float64_operations_per_second;
    /// The same as float32_operations_per_second from a compute shader. There are cards that run fragment
    /// shaders on a few of their processors only.
    std::optional<double> compute_shader_float32_operations_per_second;
};

/// The least that one step of a strategy on a problem takes, whatever else its program does.
struct StepWork {
    /// Of every array that a launch has to read or write, once a launch.
    std::uint64_t bytes = 0;
    /// Floating-point operations as the source has them: an addition, a multiplication, one of each that
    /// may be fused, a comparison, a root or a division each count as one. Masks and indices do not count.
    std::uint64_t operations = 0;
    int launches = 1;  ///< each of which waits for the one before it
    /// Of points between blocks of one launch, each of which waits for the one before it.
    int exchanges = 0;

    bool operator==(const StepWork&) const = default;
};

/// The shortest time of a step, and what keeps it from being shorter.
struct StepLimit {
    double seconds = 0;
    std::string limited_by;  ///< "launch", "exchange", "bandwidth" or "arithmetic"
};

/// The longest of the times that launches, exchanges, bytes and operations take alone, each at the device's
/// own rate. Bytes go at the rate of the cache where they fit into it.
StepLimit limit_of(const StepWork& work, const DeviceLimits& limits, Precision precision);

/// Seconds that one repetition takes at best. `seconds_of(count)` runs `count` repetitions, at least one,
/// and returns how long they took.
template <class SecondsOf>
double min_seconds(SecondsOf seconds_of) {
    // Long enough that clocks and launches do not count; so short that, on a processor shared with others,
    // some batches are over before another process takes a core.
    constexpr double long_enough = 2e-3;
    constexpr double in_all = 0.05;
    constexpr int min_batches = 8;
    constexpr int max_count = 1 << 20;  // of a clock that stands still
    seconds_of(1);                      // what happens on a first run only
    int count = 1;
    int batches = 0;
    double sum = 0;
    double min = std::numeric_limits<double>::infinity();
    while (batches < min_batches || (sum < in_all && batches < max_count)) {
        const double seconds = seconds_of(count);
        sum += seconds;
        ++batches;
        min = std::min(min, seconds);
        if (min >= long_enough || count == max_count) continue;
        // Any batch, however late: an interruption makes others seem long enough.
        count *= 2;
        batches = 0;
        sum = 0;
        min = std::numeric_limits<double>::infinity();
    }
    return min / count;
}

}  // namespace voxspring
