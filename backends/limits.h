// What a device can do at best, how much work one step needs at least, and so how fast a step could be.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

enum class Precision : std::uint8_t;

/// The rate of a pass over arrays that together have `footprint_bytes`: the highest rate of one or several
/// programs, which may differ in the width of their accesses, the number of threads, and whether they write
/// in place.
struct Bandwidth {
    double footprint_bytes = 0;
    double written_share = 0;     ///< share of the moved bytes that the pass writes
    double bytes_per_second = 0;  ///< bytes read and written per second

    bool operator==(const Bandwidth&) const = default;
};

/// The rates and times that simple programs reach on a device. Each program does only one thing, and is of
/// the kind that the backends run: CUDA kernels, compute shaders, fragment shaders, SIMD code on all cores.
struct DeviceLimits {
    /// The bandwidth at footprints from arrays that fit into the cache to arrays far larger than it. At each
    /// footprint there are several values, which differ in `written_share`. Empty if only the two rates below
    /// are known.
    std::vector<Bandwidth> bandwidth = {};
    /// Bytes read and written per second by a pass that reads two arrays and writes one, as a step does, at
    /// the largest footprint that was measured.
    double copy_bytes_per_second = 0;
    /// copy_bytes_per_second for arrays that lie in the last-level cache; 0 if the cache's size is unknown.
    double cached_copy_bytes_per_second = 0;
    double cache_bytes = 0;  ///< size of the last-level cache; 0: unknown
    /// The time from the start of one empty step to the start of the next, which waits for it: a kernel in a
    /// CUDA graph, a dispatch of one work group, or a draw of one fragment. 0 on the CPU, where a step is a
    /// function call.
    double launch_seconds = 0;
    /// The time of a barrier across the grid of a cooperative launch with one block per SM; empty if the
    /// device has no such launches.
    std::optional<double> grid_barrier_seconds;
    /// The time of one exchange between the blocks of a cooperative launch with one block per SM. In an
    /// exchange each thread sends a point to two other blocks and waits for the points that they send. Points
    /// go through the cache that the blocks share, without a barrier. Empty if the device cannot do this.
    std::optional<double> exchange_seconds;
    /// Independent multiply-adds per second, each counted as one operation; on the CPU also multiply-adds and
    /// additions in turn, if that is faster. The rate in float64 is empty if it was not measured.
    double float32_operations_per_second = 0;
    std::optional<double> float64_operations_per_second;
    /// The rate of a compute shader, if float32_operations_per_second is that of a fragment shader. Some
    /// cards run fragment shaders on only a few of their processors.
    std::optional<double> compute_shader_float32_operations_per_second;
};

/// The least work that one step of a problem takes with a backend's strategy.
struct StepWork {
    /// Bytes that the launches of the step have to move. An array counts once for each launch that reads it,
    /// and once for each that writes it.
    std::uint64_t bytes = 0;
    std::uint64_t written_bytes = 0;  ///< how many of `bytes` are written
    /// Bytes of every array that a step has to read or write, each counted once: what a cache would have to
    /// hold.
    std::uint64_t footprint_bytes = 0;
    /// Floating-point operations as in the source: an addition, a multiplication, a pair of these that may be
    /// fused, a comparison, a root or a division each count as one. Masks and indices do not count.
    std::uint64_t operations = 0;
    int launches = 1;  ///< launches per step; each waits for the one before it
    /// Exchanges of points between the blocks of a launch. Each exchange waits for the one before it.
    int exchanges = 0;

    /// Adds an array that one launch reads and none writes.
    void read_once(std::uint64_t array_bytes) {
        bytes += array_bytes;
        footprint_bytes += array_bytes;
    }

    bool operator==(const StepWork&) const = default;
};

/// The shortest time of a step, and what keeps it from being shorter.
struct StepLimit {
    double seconds = 0;
    std::string limited_by;  ///< "launch", "exchange", "bandwidth" or "arithmetic"
};

/// The bytes per second that a step with `work` can move: the best of limits.bandwidth at the largest
/// footprint that is no larger than that of `work`, and at larger ones. Between two values of
/// Bandwidth::written_share the time per byte is interpolated; beyond them it is that of the nearest value.
/// If limits.bandwidth is empty, the result is the rate of a copy, in the cache if the footprint fits.
double bytes_per_second_of(const StepWork& work, const DeviceLimits& limits);

/// The longest of the times that launches, exchanges, bytes and operations would take alone, each at the
/// device's rate.
StepLimit limit_of(const StepWork& work, const DeviceLimits& limits, Precision precision);

/// How often something is repeated to find its shortest time.
struct Patience {
    /// The least seconds per batch: long enough that clocks and launches do not matter, short enough that on
    /// a shared processor some batches end before another process takes a core.
    double long_enough = 2e-3;
    double in_all = 0.05;  ///< the least seconds of all batches together
    int min_batches = 8;
    int first_count = 1;  ///< repetitions of the first batch
};
/// The patience for one of many measurements, of passes over `footprint` bytes. If passes are short, even the
/// first batch has many, so that clocks and launches do not take most of its time.
inline Patience one_of_many(std::size_t footprint) {
    constexpr std::size_t moved_at_first = std::size_t(16) << 20;
    return {.long_enough = 1e-3,
            .in_all = 5e-3,
            .min_batches = 5,
            .first_count = int(std::clamp<std::size_t>(moved_at_first / footprint, 1, 1024))};
}

/// Seconds that one repetition takes at best. `seconds_of(count)` runs `count` repetitions, at least one, and
/// returns the seconds that they took.
template <class SecondsOf>
double min_seconds(SecondsOf seconds_of, const Patience& patience = {}) {
    const auto [long_enough, in_all, min_batches, first_count] = patience;
    constexpr int max_count = 1 << 20;  // in case a clock stands still
    seconds_of(1);                      // a first run may take longer than others
    int count = first_count;
    int batches = 0;
    double sum = 0;
    double min = std::numeric_limits<double>::infinity();
    while (batches < min_batches || (sum < in_all && batches < max_count)) {
        const double seconds = seconds_of(count);
        sum += seconds;
        ++batches;
        min = std::min(min, seconds);
        if (min >= long_enough || count == max_count) continue;
        // Any batch that is too short doubles the count, even a late one: an interruption may have made the
        // earlier batches seem long enough.
        count *= 2;
        batches = 0;
        sum = 0;
        min = std::numeric_limits<double>::infinity();
    }
    return min / count;
}

}  // namespace voxspring
