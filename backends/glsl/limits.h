// What the programs that measure the limits of an OpenGL or Vulkan device do.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <map>
#include <span>

#include "backends/glsl/device.h"

namespace voxspring::glsl {

/// Bytes of all arrays of a pass together, from sizes that most cards' caches hold to sizes that few do:
/// neither OpenGL nor Vulkan tells the size of a cache. The two or three arrays of the largest footprint are
/// within the limits of all drivers.
inline constexpr std::size_t footprints[] = {std::size_t(3) << 20, std::size_t(12) << 20,
                                             std::size_t(48) << 20, std::size_t(192) << 20};
inline constexpr std::size_t copied_word = 16;  ///< bytes per word that limits_copy.comp copies
inline constexpr std::size_t copy_group = 256;  ///< invocations per work group, as in limits_copy.comp

/// limits_arithmetic.comp has arithmetic_side^2 invocations, more than any card runs at once, in work groups
/// of arithmetic_group^2. Each makes at least `rounds` rounds, so that the time to write its output does not
/// matter.
inline constexpr int arithmetic_side = 1024, arithmetic_group = 16;
inline constexpr int rounds = 4;
inline constexpr int operations_per_round = 64;

/// The patience for measuring a launch, with more time than usual: a launch takes the host's time, so that
/// other programs on the host's cores slow many batches.
inline constexpr Patience launch_patience{.in_all = 0.15};

/// Measures what a device reaches with dispatches and a barrier after each, as a ComputeBackend steps.
DeviceLimits measure_limits(Device& device);
/// Measures only DeviceLimits::launch_seconds.
double measure_launch(Device& device);

/// One way of reading and writing arrays of words.
struct CopyPass {
    int reads;
    bool writes;
    bool in_place;

    int arrays() const { return reads + (writes && !in_place ? 1 : 0); }
    double written_share() const { return writes ? 1.0 / (reads + 1) : 0; }
};

/// Fills in `limits.bandwidth`: at each footprint and for each share of written bytes, the rate of the
/// fastest pass. The rate of a copy follows from these. `seconds_of(pass, words)`: seconds of a pass over
/// arrays of `words` words.
template <class SecondsOf>
void measure_bandwidth(DeviceLimits& limits, std::span<const CopyPass> passes, const SecondsOf& seconds_of) {
    for (const std::size_t footprint : footprints) {
        std::map<double, double> rates;
        for (const CopyPass& pass : passes) {
            const std::size_t words = footprint / copied_word / std::size_t(pass.arrays());
            const double bytes = double(words) * (pass.reads + (pass.writes ? 1 : 0)) * double(copied_word);
            double& rate = rates[pass.written_share()];
            rate = std::max(rate, bytes / seconds_of(pass, words));
        }
        for (const auto& [share, rate] : rates) limits.bandwidth.push_back({double(footprint), share, rate});
    }
    limits.copy_bytes_per_second = bytes_per_second_of(
        {.bytes = 3, .written_bytes = 1, .footprint_bytes = *std::rbegin(footprints)}, limits);
}

}  // namespace voxspring::glsl
