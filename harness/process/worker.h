// A worker: a process that answers questions of this process. A backend that runs in a worker can crash, hang
// or run out of memory without ending this process.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "harness/process/launcher.h"

namespace voxspring {

/// Thrown if the worker's process has ended. The message says how it ended, and what it was doing.
class WorkerLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// A process that a launcher has forked. It ends with this object or when this process ends, in whatever way.
/// Finite numbers in questions and answers arrive with the same bits; NaN and infinity arrive as such.
///
/// Only one worker of a Workers object works at a time, except between begin() and finish(). Before ask()
/// asks another worker, it waits until the threads of the previous worker are idle: they would otherwise take
/// cores from the worker that is timed.
class Worker {
public:
    /// `description` says which Answerer to make (case.h). `workers` must outlive this object. A `timeout`
    /// longer than 1e8 s (three years) is cut to that. Throws std::invalid_argument unless `timeout` is
    /// positive, and what Launcher throws.
    Worker(Workers& workers, const nlohmann::json& description, std::chrono::duration<double> timeout);
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;
    ~Worker();

    /// Makes the process end, and does not wait for its end. A driver takes a while to release a device, so
    /// several workers that end at the same time take less time. The worker must not be asked again.
    void dismiss();

    /// The ID of the worker's process; empty once it is known to have ended.
    std::optional<pid_t> process() const {
        return process_ > 0 ? std::optional<pid_t>(process_) : std::nullopt;
    }

    /// Asks a question and returns the answer. Throws WorkerLost if the process ends, or if it has sent
    /// nothing during the time-out and is killed; the message says what the worker was `doing`. If the
    /// Answerer throws an exception, throws Unavailable or DeviceError with its message.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});

    /// ask() in two parts, so that several workers can do work that is not timed at the same time. begin()
    /// sends the question, finish() waits for the answer. No other question may be asked between them.
    void begin(const nlohmann::json& question);
    nlohmann::json finish(const std::string& doing, const OnEvent& on_event = {});

private:
    nlohmann::json receive(const std::string& doing, std::chrono::duration<double> patience);
    [[noreturn]] void lose(const std::string& how, const std::string& doing);
    void rest();

    Workers& workers_;
    std::shared_ptr<Launcher> launcher_;  ///< the launcher that forked the worker
    int socket_ = -1;
    pid_t process_ = -1;
    std::chrono::duration<double> timeout_;
    bool asked_ = false;  ///< whether a question is still unanswered
    std::string lost_;    ///< how the process ended; empty while it runs
};

}  // namespace voxspring
