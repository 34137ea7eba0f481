// A process that answers questions for this process. What runs in it can crash, hang or run out of memory
// without ending this process.
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

/// The worker's process has ended. The message says how, and what it was doing.
class WorkerLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// A process that a launcher has forked. It ends with this object or when this process ends, in whatever way.
/// Numbers in questions and answers arrive with the same bits, NaN and infinity included.
///
/// Only one worker of the same Workers works at a time, except between begin() and finish(). Before another
/// worker is asked, the threads of the previous one have come to rest: they would otherwise take cores from
/// the one that is timed.
class Worker {
public:
    /// `description` says which Answerer to make (case.h). `workers` must outlive this. A `timeout` beyond
    /// three years is cut to three years. Throws std::invalid_argument unless `timeout` is positive, and what
    /// Launcher throws.
    Worker(Workers& workers, const nlohmann::json& description, std::chrono::duration<double> timeout);
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;
    ~Worker();

    /// Makes the process end, and does not wait until it has: a driver takes a while to release a device, and
    /// several workers can end at once. The worker must not be asked again.
    void dismiss();

    /// The worker's process; empty once it has ended.
    std::optional<pid_t> process() const {
        return process_ > 0 ? std::optional<pid_t>(process_) : std::nullopt;
    }

    /// Asks a question and returns the answer. Throws WorkerLost if the process ends, or is killed because it
    /// has sent nothing for as long as the time-out; the message says what it was `doing`. If the Answerer
    /// throws, throws Unavailable or DeviceError with the message of that exception.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});

    /// ask() in two parts, so that several workers can do at once what is not timed. Between begin() and
    /// finish() this worker must not be asked anything else.
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
    std::string lost_;    ///< how the process ended, if it has
};

}  // namespace voxspring
