// Handling of Ctrl-C: the work in progress is finished, and no further work is begun.
#pragma once

#include <csignal>

namespace voxspring {

/// While this object lives, the first SIGINT or SIGTERM makes interrupted() true and prints a message. The
/// next one removes the file that write_atomically() has not finished, and ends the process at once. With
/// `at_once` already the first signal ends the process: for work that has nothing to finish.
class CaughtInterruptions {
public:
    explicit CaughtInterruptions(bool at_once = false);
    CaughtInterruptions(const CaughtInterruptions&) = delete;
    CaughtInterruptions& operator=(const CaughtInterruptions&) = delete;
    ~CaughtInterruptions();

private:
    struct sigaction interrupt_ {
    }, terminate_{};      ///< the previous actions, to be restored
    bool ended_at_once_;  ///< `at_once` of the enclosing CaughtInterruptions, if any
};

/// Whether a signal has been caught since the latest construction of a CaughtInterruptions.
bool interrupted();

/// The exit code of an interrupted program: a shell reports the same code if SIGINT has killed a program.
constexpr int interrupted_exit_code = 130;

}  // namespace voxspring
