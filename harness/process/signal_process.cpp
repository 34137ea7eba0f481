#include "harness/process/signal_process.h"

#include <csignal>
#include <stdexcept>
#include <string>

namespace voxspring {

bool signal_process(pid_t process, int signal) {
    if (process <= 0)
        throw std::logic_error("cannot send a signal to process ID " + std::to_string(process) +
                               ": only a positive ID stands for one process");
    return kill(process, signal) == 0;
}

}  // namespace voxspring
