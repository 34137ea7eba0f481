// Ctrl-C: what is in flight is finished, nothing further begun.
#pragma once

#include <csignal>

namespace voxspring {

/// As long as it lives the first SIGINT or SIGTERM is noted and said; the next one ends the process at once,
/// and removes what write_atomically() has not finished. With `at_once` the first one does so already: for
/// work that leaves nothing to finish.
class CaughtInterruptions {
public:
    explicit CaughtInterruptions(bool at_once = false);
    CaughtInterruptions(const CaughtInterruptions&) = delete;
    CaughtInterruptions& operator=(const CaughtInterruptions&) = delete;
    ~CaughtInterruptions();

private:
    struct sigaction interrupt_ {
    }, terminate_{};      ///< what they were
    bool ended_at_once_;  ///< likewise, of the one around this one
};

/// Whether one of them has been caught since the latest CaughtInterruptions began.
bool interrupted();

/// What a shell gives for a program that SIGINT ended.
constexpr int interrupted_exit_code = 130;

}  // namespace voxspring
