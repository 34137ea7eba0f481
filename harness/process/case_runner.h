// Case runners: the code of a kind of study that runs in the worker process of a case. The worker process
// makes a runner from its registered name and parameters.
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "backends/device_choice.h"
#include "backends/registry.h"
#include "harness/process/shared_state.h"
#include "harness/process/worker.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// What a kind of study does with one backend, in the worker process of that backend.
class CaseRunner {
public:
    CaseRunner() = default;
    CaseRunner(const CaseRunner&) = delete;
    CaseRunner& operator=(const CaseRunner&) = delete;
    virtual ~CaseRunner() = default;
    virtual nlohmann::json answer(Backend& backend, const nlohmann::json& question,
                                  const OnEvent& on_event) = 0;
};

/// Makes a runner in the worker process of a case. `parameters` is CaseProgram::parameters. `shared` is
/// shared memory for one state; null if CaseProgram::shared is null. All references outlive the runner.
using CaseRunnerFactory = std::function<std::unique_ptr<CaseRunner>(
    const BackendSpec& spec, const Scene& scene, const nlohmann::json& parameters, SharedState* shared)>;

/// A CaseRunnerFactory of a type whose constructor takes the same arguments.
template <class Runner>
std::unique_ptr<CaseRunner> case_runner_of(const BackendSpec& spec, const Scene& scene,
                                           const nlohmann::json& parameters, SharedState* shared) {
    return std::make_unique<Runner>(spec, scene, parameters, shared);
}

/// Registers a runner by a static object in the runner's source file:
/// `static const RegisteredCaseRunner runner("timing", case_runner_of<TimingRunner>);`
struct RegisteredCaseRunner {
    RegisteredCaseRunner(const std::string& name, CaseRunnerFactory factory);
};

/// What a case runs: the name of a registered runner, and its parameters.
struct CaseProgram {
    std::string runner;
    nlohmann::json parameters = nlohmann::json::object();
    SharedState* shared = nullptr;  ///< must outlive the case
    /// How many threads the case's process may use; 0: one per processor. Cases on cards that
    /// StudyBench::enter_all() constructs at the same time get equal shares of the processors. With more
    /// threads than processors, threads that spin while they wait would keep other processes from running.
    int threads = 0;
    /// The device that all backends in the case's process use. The process selects it before it makes the
    /// first backend, since a backend opens its device in its constructor.
    DeviceNumber device = {};
    bool cold = false;  ///< whether the process works without the cache on disk
};

}  // namespace voxspring
