// Makes a limit on the size of files (ulimit -f) an error to report, instead of the end of the process.
#pragma once

#include <pthread.h>

#include <cerrno>
#include <csignal>
#include <ctime>

namespace voxspring {

/// While such an object exists, write() returns an error in this thread if a file may grow no further; the
/// process gets no signal that would end it.
class SizeLimitAsError {
public:
    SizeLimitAsError() {
        sigemptyset(&signal_);
        sigaddset(&signal_, SIGXFSZ);
        sigset_t pending;
        sigpending(&pending);
        was_pending_ = sigismember(&pending, SIGXFSZ) == 1;
        pthread_sigmask(SIG_BLOCK, &signal_, &before_);
    }
    SizeLimitAsError(const SizeLimitAsError&) = delete;
    SizeLimitAsError& operator=(const SizeLimitAsError&) = delete;
    ~SizeLimitAsError() {
        const int error = errno;
        const timespec at_once{};
        if (!was_pending_) (void)sigtimedwait(&signal_, nullptr, &at_once);
        pthread_sigmask(SIG_SETMASK, &before_, nullptr);
        errno = error;
    }

private:
    sigset_t signal_, before_;
    bool was_pending_;
};

}  // namespace voxspring
