// A backend that a study runs a scene on, in a process of its own.
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/process/journal.h"
#include "harness/process/worker.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// What a kind of study does with one backend, in the backend's process.
class CaseRunner {
public:
    CaseRunner() = default;
    CaseRunner(const CaseRunner&) = delete;
    CaseRunner& operator=(const CaseRunner&) = delete;
    virtual ~CaseRunner() = default;
    virtual nlohmann::json answer(Backend& backend, const nlohmann::json& question,
                                  const OnEvent& on_event) = 0;
};
/// Called in the backend's process.
using MakeCaseRunner = std::function<std::unique_ptr<CaseRunner>(const BackendSpec&)>;

/// Ctrl-C was pressed: nothing further is begun.
class Interrupted : public std::exception {
public:
    const char* what() const noexcept override { return "interrupted"; }
};

/// A backend with its options that runs a scene. Its process is started by the first question that the
/// journal has no answer to.
class Case {
public:
    /// `scene` must outlive it.
    Case(BackendSpec spec, const Scene& scene, MakeCaseRunner make_runner, JournalScope scope,
         std::chrono::duration<double> timeout);

    const BackendSpec& spec() const { return spec_; }
    /// What is finished of it.
    JournalScope& scope() { return scope_; }

    /// Constructs the backend, unless the journal has what that gave: its `capabilities`, `unsupported`
    /// (empty, or why it cannot run the scene) and `construct_seconds`. Throws as ask() does.
    nlohmann::json introduce();
    /// Of the backend that it has been introduced with.
    const nlohmann::json& capabilities() const { return scope_.find("introduction")->at("capabilities"); }
    /// Asks its runner. Throws Interrupted before it would, and what Worker::ask() throws; BadInput if the
    /// device is not the one that the journal knows.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});
    /// Measures the device's limits on a backend of its own, unless `scope` has them. Throws as ask() does.
    DeviceLimits measure_limits(JournalScope scope);

    /// The process that it has now.
    std::optional<pid_t> process() const;

    std::optional<DeviceLimits> limits;  ///< of its device; nothing: they could not be measured

private:
    void start();

    BackendSpec spec_;
    const Scene& scene_;
    MakeCaseRunner make_runner_;
    JournalScope scope_;
    std::chrono::duration<double> timeout_;
    std::unique_ptr<Worker> process_;
};

/// Calls `action`, which is about one case. Why it failed; nothing if it did not or was interrupted
/// (which is to go on when the study is resumed). Throws what is not the case's fault: BadInput,
/// Unwritten.
std::optional<std::string> failure_of(const std::function<void()>& action);

/// What `look` says of a backend, which is constructed for that in a process of its own. Throws as
/// Worker::ask() does.
nlohmann::json look_at(const BackendSpec& spec, const std::function<nlohmann::json(const Backend&)>& look,
                       std::chrono::duration<double> timeout);

}  // namespace voxspring
