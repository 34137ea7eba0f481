// What runs in a case's process, made there from a name and parameters.
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "harness/process/case.h"
#include "harness/process/shared_state.h"

namespace voxspring {

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
};

/// Makes the runner of `program` for `scene`, which must outlive what it makes. Throws std::logic_error for a
/// name that is not registered.
MakeCaseRunner maker_of(const CaseProgram& program, const Scene& scene);

}  // namespace voxspring
