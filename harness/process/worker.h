// A process that answers questions for this one, so that what runs in it can crash, hang or run out of memory
// without taking this one along.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "harness/process/launcher.h"

namespace voxspring {

/// The process is gone: the message says how it ended and what it was doing.
class WorkerLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Sends this process's parent word of something before the answer.
using OnEvent = std::function<void(const nlohmann::json& event)>;

/// What answers in the other process.
class Answerer {
public:
    Answerer() = default;
    Answerer(const Answerer&) = delete;
    Answerer& operator=(const Answerer&) = delete;
    virtual ~Answerer() = default;
    virtual nlohmann::json answer(const nlohmann::json& question, const OnEvent& on_event) = 0;
};

/// A process that a launcher has forked. It ends with this object, or when this process does, however that
/// happens. Numbers travel to the bit, those that are not finite too.
///
/// Only one of them works at a time, unless begin() says otherwise: before another one of the same Workers is
/// asked, the threads of the one before have come to rest, where they would take the cores that the next one
/// is timed on.
class Worker {
public:
    /// `description` says what is to answer (case.h). `workers` must outlive this. A `timeout` of more than
    /// three years is one of three years. Throws std::invalid_argument unless it is positive, and what
    /// Launcher throws.
    Worker(Workers& workers, const nlohmann::json& description, std::chrono::duration<double> timeout);
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;
    ~Worker();

    /// Whether it has answered whatever it was asked, without a failure, so that another description is in
    /// good hands with it.
    bool can_be_used_again() const { return process_ >= 0 && !asked_ && !failed_; }
    /// Has its answerer end, and does not wait for it; become() is what may be called next.
    void begin_leaving();
    /// Has it answer for another description, and on the scene that its Workers have turned to since. Throws
    /// as ask() does.
    void become(const nlohmann::json& description);
    /// Whether it answered for another description before.
    bool has_left() const { return has_left_; }

    /// Has the process end, and does not wait for it: a driver takes its time to give a device back, and
    /// those of several workers may do so at once. It is not to be asked again.
    void dismiss();

    /// Nothing once it has ended.
    std::optional<pid_t> process() const {
        return process_ > 0 ? std::optional<pid_t>(process_) : std::nullopt;
    }

    /// The answer. Throws WorkerLost if the process ends, or says nothing for as long as the time-out, while
    /// `doing` (it is then killed); Unavailable or DeviceError with the message of what its answerer threw.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});

    /// ask() in two parts, so that several work at once on what is not timed. Between them it is asked
    /// nothing else.
    void begin(const nlohmann::json& question);
    nlohmann::json finish(const std::string& doing, const OnEvent& on_event = {});

private:
    nlohmann::json receive(const std::string& doing, std::chrono::duration<double> patience);
    [[noreturn]] void lose(const std::string& how, const std::string& doing);
    void rest();

    Workers& workers_;
    std::shared_ptr<Launcher> launcher_;  ///< that it is from
    int socket_ = -1;
    pid_t process_ = -1;
    std::chrono::duration<double> timeout_;
    int scene_number_;       ///< of its Workers' scenes
    bool asked_ = false;     ///< and no answer yet
    bool failed_ = false;    ///< an answer was a refusal
    bool has_left_ = false;  ///< an answerer before this one
    std::string lost_;       ///< how it ended, if it has
};

}  // namespace voxspring
