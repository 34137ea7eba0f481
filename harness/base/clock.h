// The clock by which durations are measured.
#pragma once

#include <chrono>

namespace voxspring {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

inline double seconds_since(Clock::time_point begin) { return Seconds(Clock::now() - begin).count(); }

}  // namespace voxspring
