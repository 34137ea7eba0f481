// A case of a study: one backend that is measured on one scene, in another process.
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

/// Thrown instead of beginning further work after SIGINT (Ctrl-C) or SIGTERM.
class Interrupted : public std::exception {
public:
    const char* what() const noexcept override { return "interrupted"; }
};

/// How many processes time the batches of a backend that steps on the host (measure.h). A time differs
/// between processes, since it depends on where the system puts a process's memory and threads.
constexpr int host_processes = 3;

/// How many processes of a commit measure the limits of a card. Later ones take the best of these. The first
/// study measures a host's limits in as many processes, and each later one in one.
constexpr int limits_processes = 3;

/// A process that several cases share, once the first of them has started it. Opening a card takes some APIs
/// a quarter of a second per process, far longer than most cases are timed.
struct SharedProcess {
    std::weak_ptr<WorkerProcess> process;
};

/// One backend, with its options, that is measured on one scene. The backend runs in a worker process, which
/// is started only for a measurement that the journal (the file of finished measurements) does not have.
class Case {
public:
    /// `workers` must have been given the scene, and must outlive the case. The case has a process without
    /// others if `shared` is null. In a shared process a case may fail by the fault of another one. So a case
    /// that fails there has to be measured again in a process without others.
    Case(BackendSpec spec, Workers& workers, CaseProgram program, JournalScope scope,
         std::chrono::duration<double> timeout, std::shared_ptr<SharedProcess> shared = nullptr);

    bool shares_process() const { return shared_ != nullptr; }
    /// Returns this case again, in a process without others.
    Case alone() const { return Case(spec_, *workers_, program_, scope_, timeout_); }
    /// Says on standard error that the case failed in a shared process, why, and that it is measured again.
    void say_measured_again(const std::string& reason) const;

    const BackendSpec& spec() const { return spec_; }
    /// The part of the journal that has the finished measurements of this case.
    JournalScope& scope() { return scope_; }

    /// Constructs the backend, unless the journal has the result. Returns `capabilities`,
    /// `construct_seconds`, `unsupported` (why the backend cannot run the scene; empty if it can) and
    /// `outpaced` (why another backend is faster; empty if none is, see outpaced.h). Throws what ask()
    /// throws.
    nlohmann::json introduce();
    /// To construct the backends of several cases at the same time, call begin_introduction() of each case,
    /// then await_introduction() of each, then introduce(). Each construction then takes longer than alone.
    /// Backends in one process are constructed one after the other. Errors are kept until introduce(), which
    /// throws them.
    void begin_introduction();
    void await_introduction();
    /// The capabilities of the backend, after introduce().
    const nlohmann::json& capabilities() const;
    /// Asks the CaseRunner in the worker process a question, and returns the answer. `doing` says in messages
    /// what the process was doing. Throws Interrupted, before asking, after SIGINT or SIGTERM; BadInput if
    /// the device is not the one in the journal; Unwritten; and what Worker's constructor and Worker::ask()
    /// throw.
    nlohmann::json ask(const nlohmann::json& question, const std::string& doing,
                       const OnEvent& on_event = {});
    /// Returns the measurement `name` of the journal. If the journal has neither this measurement nor a
    /// failure of the case, calls `make` and keeps its result in the journal. If `make` fails in a shared
    /// process, calls it again in a process without other cases. If it fails there, keeps `at` + the reason
    /// as the case's failure. Returns null if the case failed or was interrupted before this measurement.
    const nlohmann::json* kept(const std::string& name, const std::function<nlohmann::json()>& make,
                               const std::string& at = {});
    /// ask() in two parts: begin() sends the question, finish() waits for the answer. See Worker.
    void begin(const nlohmann::json& question);
    nlohmann::json finish(const std::string& doing, const OnEvent& on_event = {});
    /// Measures the limits of the device on a separate backend, unless `scope` has them or limits_processes
    /// have measured those of a card. Returns the best that this commit has measured (best_so_far() of
    /// limits.h). Throws DeviceError if they cannot be measured. BadInput, Unwritten and Interrupted pass
    /// through.
    DeviceLimits measure_limits(JournalScope scope);
    /// Ends the worker process, if there is one and no other case shares it. If it has ended, the next
    /// question starts another process.
    void restart() { process_.reset(); }
    /// Starts a further worker process, asks it the questions in turn, and ends it. Returns the result of
    /// introduce() in that process and then the answers. With `cold` that process works without this
    /// program's cache of compiled kernels on disk; a driver may have its own. Throws what ask() throws.
    std::vector<nlohmann::json> afresh(const std::vector<nlohmann::json>& questions, const std::string& doing,
                                       bool cold = false);

    /// Makes the worker process end, if there is one, once all cases that share it are dismissed. Does not
    /// wait for its end. No question may follow.
    void dismiss();

    /// The ID of the worker process, if there is one.
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
    std::shared_ptr<SharedProcess> shared_;
    std::unique_ptr<Worker> process_;
    bool introducing_ = false;      ///< whether an answer to begin_introduction() is still to come
    std::exception_ptr too_early_;  ///< an error of begin_introduction() or await_introduction()
};

/// The backends of `cases`, in their order.
std::vector<BackendSpec> specs_of(const std::vector<Case>& cases);

/// Calls `action`, which concerns one case, and returns why it failed. The result is empty if `action`
/// succeeded or was interrupted: an interrupted case goes on when the study is resumed. Rethrows BadInput and
/// Unwritten, since these are not failures of the case.
std::optional<std::string> failure_of(const std::function<void()>& action);

/// Constructs a backend on `device` in a worker process. Returns what Case::introduce() returns, and throws
/// what Worker's constructor and Worker::ask() throw.
nlohmann::json introduce(const BackendSpec& spec, Workers& workers, std::chrono::duration<double> timeout,
                         DeviceNumber device = {});

/// case_description() makes the description of a case, which its worker process receives. That process calls
/// case_answerer(), which makes the Answerer of questions from the description.
nlohmann::json case_description(const BackendSpec& spec, const CaseProgram& program);
Answerer case_answerer(const nlohmann::json& description, const Scene* scene);

}  // namespace voxspring
