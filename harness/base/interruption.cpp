#include "harness/base/interruption.h"

#include <unistd.h>

#include <cerrno>
#include <string_view>

#include "harness/base/files.h"

namespace voxspring {
namespace {

volatile std::sig_atomic_t signals_caught = 0;
volatile std::sig_atomic_t ends_at_once = 0;

void say(std::string_view message) { (void)!write(STDERR_FILENO, message.data(), message.size()); }

/// The signal handler. It calls async-signal-safe functions only. The code that it interrupts may be about to
/// read errno, which a failing write would have changed.
void note(int) {
    const int before = errno;
    signals_caught = signals_caught + 1;
    if (ends_at_once != 0 || signals_caught > 1) {
        remove_unfinished_file();
        if (signals_caught == 1) say("\nvoxspring: interrupted\n");
        _exit(interrupted_exit_code);
    }
    say("\nvoxspring: stopping after the work in progress; interrupt again to stop at once\n");
    errno = before;
}

}  // namespace

CaughtInterruptions::CaughtInterruptions(bool at_once) : ended_at_once_(ends_at_once != 0) {
    signals_caught = 0;
    ends_at_once = at_once ? 1 : 0;
    struct sigaction action {};
    action.sa_handler = note;
    sigaction(SIGINT, &action, &interrupt_);
    sigaction(SIGTERM, &action, &terminate_);
}

CaughtInterruptions::~CaughtInterruptions() {
    sigaction(SIGINT, &interrupt_, nullptr);
    sigaction(SIGTERM, &terminate_, nullptr);
    ends_at_once = ended_at_once_ ? 1 : 0;
}

bool interrupted() { return signals_caught > 0; }

}  // namespace voxspring
