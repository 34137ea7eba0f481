#include "harness/process/case_runner.h"

#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace voxspring {
namespace {

std::map<std::string, CaseRunnerFactory>& factories() {
    static std::map<std::string, CaseRunnerFactory> all;
    return all;
}

}  // namespace

RegisteredCaseRunner::RegisteredCaseRunner(const std::string& name, CaseRunnerFactory factory) {
    factories().emplace(name, std::move(factory));
}

nlohmann::json to_json(const CaseProgram& program) {
    return {{"runner", program.runner},
            {"parameters", program.parameters},
            {"shared", program.shared != nullptr ? program.shared->description() : nlohmann::json()},
            {"threads", program.threads},
            {"device",
             {{"number", program.device.number},
              {"wraps", program.device.wraps},
              {"parts", program.device.parts}}}};
}

std::unique_ptr<CaseRunner> make_case_runner(const nlohmann::json& program, const BackendSpec& spec,
                                             const Scene& scene, SharedState* shared) {
    const std::string name = program.at("runner");
    const auto found = factories().find(name);
    if (found == factories().end()) throw std::logic_error("no case runner is called " + name);
    return found->second(spec, scene, program.at("parameters"), shared);
}

}  // namespace voxspring
