// The code that runs in a case's process. The process makes it from a name and parameters.
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

/// What a kind of study does with one backend, in that backend's process.
class CaseRunner {
public:
    CaseRunner() = default;
    CaseRunner(const CaseRunner&) = delete;
    CaseRunner& operator=(const CaseRunner&) = delete;
    virtual ~CaseRunner() = default;
    virtual nlohmann::json answer(Backend& backend, const nlohmann::json& question,
                                  const OnEvent& on_event) = 0;
};

/// Makes a runner in the case's process. `parameters` comes from the kind of study. `shared` is room for one
/// state; null if CaseProgram::shared is null. All references outlive the runner.
using CaseRunnerFactory = std::function<std::unique_ptr<CaseRunner>(
    const BackendSpec& spec, const Scene& scene, const nlohmann::json& parameters, SharedState* shared)>;

/// Registers a runner, in the file of a kind of study:
/// `static const RegisteredCaseRunner runner("timing", ...);`
struct RegisteredCaseRunner {
    RegisteredCaseRunner(const std::string& name, CaseRunnerFactory factory);
};

/// What a case runs: the name of a registered runner, and its parameters.
struct CaseProgram {
    std::string runner;
    nlohmann::json parameters = nlohmann::json::object();
    SharedState* shared = nullptr;  ///< must outlive the case
    /// How many threads the case's process may use; 0: one per processor. Cases that run at the same time get
    /// a share of the processors each: a thread that spins while it waits would keep a processor from another
    /// process.
    int threads = 0;
    /// The device of all backends in the case's process. It is set before the first backend is made, since a
    /// backend opens its device in its constructor.
    DeviceNumber device = {};
    bool cold = false;  ///< the process finds nothing in the cache on disk, and keeps nothing there
};

}  // namespace voxspring
