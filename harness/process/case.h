// A case: a backend on which a study runs a scene, in a separate process.
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/process/case_runner.h"
#include "harness/process/journal.h"
#include "harness/process/worker.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// Ctrl-C was pressed: no further work is begun.
class Interrupted : public std::exception {
public:
    const char* what() const noexcept override { return "interrupted"; }
};

/// How many processes measure a time or a rate of the host's processor, which depends on where the system
/// puts a process's memory and threads.
constexpr int host_processes = 3;

/// One backend, with its options, that is measured on one scene. It runs in a worker process, which starts
/// only when something is asked that the journal of finished measurements does not have.
class Case {
public:
    /// `workers`, which have the scene, must outlive the case.
    Case(BackendSpec spec, Workers& workers, CaseProgram program, JournalScope scope,
         std::chrono::duration<double> timeout);

    const BackendSpec& spec() const { return spec_; }
    /// The finished measurements of the case.
    JournalScope& scope() { return scope_; }

    /// Constructs the backend, unless the journal has the result. Returns `capabilities`,
    /// `construct_seconds`, `unsupported` (empty, or why it cannot run the scene) and `outpaced`
    /// (outpaced.h). Throws as ask().
    nlohmann::json introduce();
    /// Let several cases construct their backends at once, before introduce() is called: first
    /// begin_introduction() of each, then await_introduction() of each. A construction then takes longer.
    /// Errors are kept until introduce(), which throws them.
    void begin_introduction();
    void await_introduction();
    /// The capabilities of the backend, after introduce().
    const nlohmann::json& capabilities() const;
    /// Asks the case's CaseRunner. Throws Interrupted, before asking, if Ctrl-C was pressed; BadInput if the
    /// device is not the one in the journal; and what Worker::ask() throws.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});
    /// Returns the measurement `name` of the journal. If the journal has neither this nor a failure of the
    /// case, calls `make` and keeps the result. If `make` fails, keeps the reason as the case's failure, with
    /// `at` before it. Returns null if the case failed or was interrupted.
    const nlohmann::json* kept(const std::string& name, const std::function<nlohmann::json()>& make,
                               const std::string& at = {});
    /// ask() in two parts, as Worker::begin() and Worker::finish().
    void begin(const nlohmann::json& question);
    nlohmann::json finish(const std::string& doing, const OnEvent& on_event = {});
    /// Measures the device's limits on a separate backend, unless `scope` has them. Returns the best that
    /// this build has ever measured on the device (best_so_far() of limits.h). Throws as ask() does.
    DeviceLimits measure_limits(JournalScope scope);
    /// Ends the process, if any. The next question starts another one.
    void restart() { process_.reset(); }
    /// Starts a further process, asks it the questions in turn, and ends it. Returns the introduction and the
    /// answers. With `cold` it finds no compiled kernel on disk. Throws as ask() does.
    std::vector<nlohmann::json> afresh(const std::vector<nlohmann::json>& questions, const std::string& doing,
                                       bool cold = false);

    /// Ends the process, if any, and does not wait for that. The case must not be asked again.
    void dismiss();

    /// The current process, if there is one.
    std::optional<pid_t> process() const;

    std::optional<DeviceLimits> limits;  ///< limits of the case's device; empty: not measured

private:
    void start();
    void make_process();
    void take_introduction(const nlohmann::json& introduction);

    BackendSpec spec_;
    Workers* workers_;
    CaseProgram program_;
    JournalScope scope_;
    std::chrono::duration<double> timeout_;
    std::unique_ptr<Worker> process_;
    bool introducing_ = false;      ///< whether await_introduction() has to await an answer
    std::exception_ptr too_early_;  ///< the error of begin_introduction()
};

/// Calls `action`, which concerns one case, and returns why it failed. Empty if it succeeded or was
/// interrupted; an interrupted case goes on when the study is resumed. Throws what is not the case's fault:
/// BadInput, Unwritten.
std::optional<std::string> failure_of(const std::function<void()>& action);

/// Constructs a backend in a worker. Returns what Case::introduce() returns, and throws as Worker::ask()
/// does.
nlohmann::json introduce(const BackendSpec& spec, Workers& workers, std::chrono::duration<double> timeout);

/// The description that a case's process is started with, and the Answerer that this process makes from it.
nlohmann::json case_description(const BackendSpec& spec, const CaseProgram& program);
Answerer case_answerer(const nlohmann::json& description, const Scene* scene);

}  // namespace voxspring
