#include "harness/process/signal_process.h"

#include <csignal>
#include <stdexcept>
#include <string>

namespace voxspring {

bool signal_process(pid_t process, int signal) {
    if (process <= 0)
        throw std::logic_error("a signal to process " + std::to_string(process) +
                               ", which is not one process");
    return kill(process, signal) == 0;
}

}  // namespace voxspring
