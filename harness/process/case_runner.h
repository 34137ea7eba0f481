// What runs in a case's process, made there from a name and parameters.
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

/// Makes a runner in the case's process. `parameters` is whatever the kind of study gave; `shared`, room for
/// one state, is null where it asked for none. All references outlive the runner.
using CaseRunnerFactory = std::function<std::unique_ptr<CaseRunner>(
    const BackendSpec& spec, const Scene& scene, const nlohmann::json& parameters, SharedState* shared)>;

/// `static const RegisteredCaseRunner runner("timing", ...);` in the file of a kind of study.
struct RegisteredCaseRunner {
    RegisteredCaseRunner(const std::string& name, CaseRunnerFactory factory);
};

/// What a case is to run: a registered runner and what it is made from.
struct CaseProgram {
    std::string runner;
    nlohmann::json parameters = nlohmann::json::object();
    SharedState* shared = nullptr;  ///< must outlive the case
    /// That the case's process has at most of its own; 0: as many as there are processors. Where cases work
    /// side by side each takes its share: a thread that waits for others of its process keeps a processor
    /// from those of another.
    int threads = 0;
    /// That all backends of the case's process take, from the first on: a backend opens its device when it is
    /// made.
    DeviceNumber device = {};
};

/// What the case's process is told of its program.
nlohmann::json to_json(const CaseProgram& program);
/// In the case's process: makes the runner of `program`, as to_json() has it, in which `shared` is at hand.
/// Throws std::logic_error for a name that is not registered.
std::unique_ptr<CaseRunner> make_case_runner(const nlohmann::json& program, const BackendSpec& spec,
                                             const Scene& scene, SharedState* shared);

}  // namespace voxspring
