// Ctrl-C: what is in flight is finished, nothing further begun.
#pragma once

namespace voxspring {

/// From here on the first SIGINT or SIGTERM is noted and said; the next one ends the process at once.
void catch_interruptions();

bool interrupted();

/// What a shell gives for a program that SIGINT ended.
constexpr int interrupted_exit_code = 130;

}  // namespace voxspring
