#include "harness/base/interruption.h"

#include <unistd.h>

#include <string_view>

namespace voxspring {
namespace {

volatile std::sig_atomic_t signals_caught = 0;

/// Calls nothing but what a signal may interrupt.
void note(int) {
    signals_caught = signals_caught + 1;
    if (signals_caught > 1) _exit(interrupted_exit_code);
    constexpr std::string_view message =
        "\nvoxspring: stopping after what is in flight; once more to stop at once\n";
    (void)!write(STDERR_FILENO, message.data(), message.size());
}

}  // namespace

CaughtInterruptions::CaughtInterruptions() {
    signals_caught = 0;
    struct sigaction action {};
    action.sa_handler = note;
    sigaction(SIGINT, &action, &interrupt_);
    sigaction(SIGTERM, &action, &terminate_);
}

CaughtInterruptions::~CaughtInterruptions() {
    sigaction(SIGINT, &interrupt_, nullptr);
    sigaction(SIGTERM, &terminate_, nullptr);
}

bool interrupted() { return signals_caught > 0; }

}  // namespace voxspring
