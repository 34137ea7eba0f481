// Sends signals to other processes.
#pragma once

#include <sys/types.h>

namespace voxspring {

/// Sends `signal` to one process. Returns false if it could not be sent, for example because the process has
/// ended. Throws std::logic_error unless `process` is positive: kill() would send a signal for 0 or a
/// negative number to a group of processes, and for -1 to every process that this one may signal.
bool signal_process(pid_t process, int signal);

}  // namespace voxspring
