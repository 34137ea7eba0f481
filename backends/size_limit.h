// A limit on the size of files (ulimit -f) is an error to report, not the end of the process.
#pragma once

#include <pthread.h>

#include <cerrno>
#include <csignal>
#include <ctime>

namespace voxspring {

/// As long as it lives, a file of this thread's that may grow no further is an error of write() rather than a
/// signal that ends the process.
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
