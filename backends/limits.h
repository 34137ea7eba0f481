// What a device can do at best, what one step needs at least, and so how fast a step could be.
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

/// What a pass over arrays reaches that together take `footprint_bytes`: the best of several programs, which
/// differ in how wide their accesses are, how many threads they have and whether they write in place.
struct Bandwidth {
    double footprint_bytes = 0;
    double written_share = 0;     ///< of the bytes that a pass reads or writes, those that it writes
    double bytes_per_second = 0;  ///< read and written

    bool operator==(const Bandwidth&) const = default;
};

/// What simple programs reach on a device that do one thing each, in the kind of program that its backends
/// run: CUDA kernels, fragment shaders, SIMD code on all cores.
struct DeviceLimits {
    /// From arrays in the cache to arrays far beyond it, for each of some shares of writing. Empty where only
    /// the two rates below are known.
    std::vector<Bandwidth> bandwidth = {};
    /// Bytes read and written by a pass that reads two arrays and overwrites one, as a step does, each far
    /// larger than any cache.
    double copy_bytes_per_second = 0;
    /// The rate of that copy where the arrays lie in the last-level cache; 0 where its size is unknown.
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
    /// Rate of independent multiply-adds, each counted as one operation.
    double float32_operations_per_second = 0;
    std::optional<double> float64_operations_per_second;
    /// float32_operations_per_second of a compute shader. There are cards that run fragment
    /// shaders on a few of their processors only.
    std::optional<double> compute_shader_float32_operations_per_second;
};

/// The least that one step of a strategy on a problem takes, whatever else its program does.
struct StepWork {
    /// Bytes of every array that a launch has to read or write, once per launch for either.
    std::uint64_t bytes = 0;
    std::uint64_t written_bytes = 0;  ///< of `bytes`
    /// Bytes of every array that a step has to read or write, once: what a cache would have to hold.
    std::uint64_t footprint_bytes = 0;
    /// Floating-point operations as the source has them: an addition, a multiplication, one of each that
    /// may be fused, a comparison, a root or a division each count as one. Masks and indices do not count.
    std::uint64_t operations = 0;
    int launches = 1;  ///< each of which waits for the one before it
    /// Exchanges of points between blocks of one launch, each of which waits for the one before it.
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

/// Bytes a second of a step that reads and writes as `work` does, at its own footprint: what was measured at
/// the largest footprint that is no larger, or at a larger one if that was faster. Between two shares of
/// writing the time of a byte is interpolated; beyond them it is that of the nearest. Without a table it is
/// the rate of a copy, that of the cache where the footprint fits into it.
double bytes_per_second_of(const StepWork& work, const DeviceLimits& limits);

/// The longest of the times that launches, exchanges, bytes and operations take alone, each at the device's
/// own rate.
StepLimit limit_of(const StepWork& work, const DeviceLimits& limits, Precision precision);

/// How long something is repeated to find its shortest time.
struct Patience {
    /// Seconds of a batch: long enough that clocks and launches do not count; so short that, on a processor
    /// shared with others, some batches are over before another process takes a core.
    double long_enough = 2e-3;
    double in_all = 0.05;  ///< seconds of all batches together, at least
    int min_batches = 8;
    int first_count = 1;  ///< repetitions of the first batch
};
/// For one of many measurements, each of a pass over `footprint` bytes: batches begin so long that no clock
/// or launch takes most of one.
inline Patience one_of_many(std::size_t footprint) {
    constexpr std::size_t moved_at_first = std::size_t(16) << 20;
    return {.long_enough = 1e-3,
            .in_all = 5e-3,
            .min_batches = 5,
            .first_count = int(std::clamp<std::size_t>(moved_at_first / footprint, 1, 1024))};
}

/// Seconds that one repetition takes at best. `seconds_of(count)` runs `count` repetitions, at least one,
/// and returns how long they took.
template <class SecondsOf>
double min_seconds(SecondsOf seconds_of, const Patience& patience = {}) {
    const auto [long_enough, in_all, min_batches, first_count] = patience;
    constexpr int max_count = 1 << 20;  // of a clock that stands still
    seconds_of(1);                      // what happens on a first run only
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
        // Any batch, however late: an interruption makes others seem long enough.
        count *= 2;
        batches = 0;
        sum = 0;
        min = std::numeric_limits<double>::infinity();
    }
    return min / count;
}

}  // namespace voxspring
