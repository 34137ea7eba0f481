// A backend that a study runs a scene on, in a process of its own.
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/process/case_runner.h"
#include "harness/process/journal.h"
#include "harness/process/worker.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// Ctrl-C was pressed: nothing further is begun.
class Interrupted : public std::exception {
public:
    const char* what() const noexcept override { return "interrupted"; }
};

/// A backend with its options that runs a scene. Its process is started by the first question that the
/// journal has no answer to.
class Case {
public:
    /// `workers`, which have the scene, must outlive it. With `second_hand` its process may have been that
    /// of a case before, where nobody wants to know how long constructing takes.
    Case(BackendSpec spec, Workers& workers, CaseProgram program, JournalScope scope,
         std::chrono::duration<double> timeout, bool second_hand = false);

    const BackendSpec& spec() const { return spec_; }
    /// What is finished of it.
    JournalScope& scope() { return scope_; }

    /// Constructs the backend, unless the journal has what that gave: its `capabilities`, `unsupported`
    /// (empty, or why it cannot run the scene) and `construct_seconds`. Throws as ask() does.
    nlohmann::json introduce();
    /// The same ahead of time and in two parts, so that several cases construct at once, which takes each of
    /// them longer: it begins, and waits. What goes wrong introduce() throws.
    void begin_introduction();
    void await_introduction();
    /// Of the backend that it has been introduced with.
    const nlohmann::json& capabilities() const { return scope_.find("introduction")->at("capabilities"); }
    /// Asks its runner. Throws Interrupted before it would, and what Worker::ask() throws; BadInput if the
    /// device is not the one that the journal knows.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});
    /// Worker::begin() and finish() with its runner.
    void begin(const nlohmann::json& question);
    nlohmann::json finish(const std::string& doing, const OnEvent& on_event = {}) {
        return process_->finish(doing, on_event);
    }
    /// Measures the device's limits on a backend of its own, unless `scope` has them. Throws as ask() does.
    DeviceLimits measure_limits(JournalScope scope);

    /// It is not to be asked again: the process that it has now, if any, ends or, second hand, is for the
    /// next case of its API. Does not wait for that.
    void dismiss();

    /// The process that it has now.
    std::optional<pid_t> process() const;

    std::optional<DeviceLimits> limits;  ///< of its device; nothing: they could not be measured

private:
    void start();
    void make_process();
    std::unique_ptr<Worker> new_process();
    /// What `answer` gives, or what a new process does where that failed in one that has been used before.
    nlohmann::json introduction_of(const std::function<nlohmann::json()>& answer);
    void take_introduction(const nlohmann::json& introduction);

    BackendSpec spec_;
    Workers* workers_;
    CaseProgram program_;
    JournalScope scope_;
    std::chrono::duration<double> timeout_;
    bool second_hand_;
    std::unique_ptr<Worker> process_;
    bool introducing_ = false;      ///< it has begun
    std::exception_ptr too_early_;  ///< what went wrong ahead of time
};

/// "cuda" of cuda_march: what a driver opens for one of an API it has for the next.
std::string api_of(const BackendSpec& spec);

/// Calls `action`, which is about one case. Why it failed; nothing if it did not or was interrupted
/// (which is to go on when the study is resumed). Throws what is not the case's fault: BadInput,
/// Unwritten.
std::optional<std::string> failure_of(const std::function<void()>& action);

/// Introduces a backend, as Case::introduce() does, which is constructed for that alone. Throws as
/// Worker::ask() does.
nlohmann::json introduce(const BackendSpec& spec, Workers& workers, std::chrono::duration<double> timeout);

/// What answers in a case's process, and the description that it is started with.
nlohmann::json case_description(const BackendSpec& spec, const CaseProgram& program);
std::unique_ptr<Answerer> case_answerer(const nlohmann::json& description, const Scene* scene);

}  // namespace voxspring
