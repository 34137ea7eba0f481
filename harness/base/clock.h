// The clocks by which durations and processor time are measured.
#pragma once

#include <chrono>
#include <ctime>

namespace voxspring {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

inline double seconds_since(Clock::time_point begin) { return Seconds(Clock::now() - begin).count(); }

/// The processor time of this thread, which Google Benchmark calls cpu_time, for CLOCK_THREAD_CPUTIME_ID;
/// that of the process for CLOCK_PROCESS_CPUTIME_ID.
inline double processor_seconds(clockid_t clock) {
    timespec time{};
    clock_gettime(clock, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

}  // namespace voxspring
