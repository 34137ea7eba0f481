#include "harness/process/case_runner.h"

#include <map>
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

MakeCaseRunner maker_of(const CaseProgram& program, const Scene& scene) {
    const auto found = factories().find(program.runner);
    if (found == factories().end()) throw std::logic_error("no case runner is called " + program.runner);
    return [&factory = found->second, program, &scene](const BackendSpec& spec) {
        return factory(spec, scene, program.parameters, program.shared);
    };
}

}  // namespace voxspring
