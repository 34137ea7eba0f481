// A worker answers questions of this process in another process. A backend that runs in a worker can crash,
// hang or run out of memory without ending this process.
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

class WorkerProcess;

/// Thrown if the worker's process has ended. The message says how it ended, and what it was doing.
class WorkerLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// One answerer in a process that a launcher has forked. The process has one worker or several. It ends with
/// the last of them or when this process ends, in whatever way. Finite numbers in questions and answers
/// arrive with the same bits; NaN and infinity arrive as such.
///
/// Only one worker of a Workers object works at a time, except between begin() and finish(). Before ask()
/// asks a worker in another process, it waits until the threads of the previous worker are idle, but no
/// longer than about 50 ms: they would otherwise take cores from the worker that is timed.
class Worker {
public:
    /// `description` says which Answerer to make (case.h). The answerer lives in `process`, or in a new
    /// process if that is null. `workers` must outlive this object. A `timeout` longer than 1e8 s (three
    /// years) is cut to that. Throws std::invalid_argument unless `timeout` is positive, and what Launcher
    /// throws.
    Worker(Workers& workers, const nlohmann::json& description, std::chrono::duration<double> timeout,
           std::shared_ptr<WorkerProcess> process = nullptr);
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;
    ~Worker();

    /// Makes the process end once all its workers are dismissed, and does not wait for its end. A driver
    /// takes a while to release a device, so several processes that end at the same time take less time. The
    /// worker must not be asked again.
    void dismiss();

    /// The ID of the worker's process; empty once it is known to have ended.
    std::optional<pid_t> process() const;
    /// The process, for further workers in it.
    const std::shared_ptr<WorkerProcess>& shared_process() const { return process_; }

    /// Asks a question and returns the answer. Throws WorkerLost if the process ends, or if it has sent
    /// nothing during the time-out and is killed; the message says what the worker was `doing`. If the
    /// Answerer throws an exception, throws Unavailable or DeviceError with its message.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});

    /// ask() in two parts, so that several workers can do work that is not timed at the same time. begin()
    /// sends the question, finish() waits for the answer. No other question may be asked of this worker
    /// between them. Workers of one process answer one after the other.
    void begin(const nlohmann::json& question);
    nlohmann::json finish(const std::string& doing, const OnEvent& on_event = {});

private:
    void rest();

    Workers& workers_;
    std::shared_ptr<WorkerProcess> process_;
    int number_ = 0;  ///< of this worker among those of its process
    std::chrono::duration<double> timeout_;
    bool dismissed_ = false;
};

}  // namespace voxspring
