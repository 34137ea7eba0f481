// Ctrl-C: the work in flight is finished, and no further work is begun.
#pragma once

#include <csignal>

namespace voxspring {

/// While this object lives, the first SIGINT or SIGTERM is noted and reported. The next one ends the process
/// at once, and removes the file that write_atomically() has not finished. With `at_once` the first signal
/// already ends the process: for work that leaves nothing to finish.
class CaughtInterruptions {
public:
    explicit CaughtInterruptions(bool at_once = false);
    CaughtInterruptions(const CaughtInterruptions&) = delete;
    CaughtInterruptions& operator=(const CaughtInterruptions&) = delete;
    ~CaughtInterruptions();

private:
    struct sigaction interrupt_ {
    }, terminate_{};      ///< the previous actions, to be restored
    bool ended_at_once_;  ///< `at_once` of the enclosing CaughtInterruptions
};

/// Whether a signal has been caught since the latest CaughtInterruptions began.
bool interrupted();

/// The exit code that a shell reports for a program that SIGINT ended.
constexpr int interrupted_exit_code = 130;

}  // namespace voxspring
