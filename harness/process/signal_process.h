// Signals to other processes.
#pragma once

#include <sys/types.h>

namespace voxspring {

/// Sends `signal` to one process. Returns whether it was sent, which fails if the process has ended. Throws
/// std::logic_error unless `process` is positive: kill() takes 0 and negative numbers for groups of
/// processes, and -1 for every process of the user.
bool signal_process(pid_t process, int signal);

}  // namespace voxspring
