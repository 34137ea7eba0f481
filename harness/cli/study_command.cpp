#include <nlohmann/json.hpp>
#include <ostream>
#include <string>

#include "harness/base/interruption.h"
#include "harness/cli/commands.h"
#include "harness/device/limits.h"
#include "harness/results/result.h"
#include "harness/study/fastest.h"
#include "harness/study/pareto.h"
#include "harness/study/stability_study.h"
#include "harness/study/stress.h"
#include "harness/study/study.h"

namespace voxspring {

int run_and_print_study(const std::string& argument, const StudyOptions& options, std::ostream& out) {
    const nlohmann::json result = run_study(load_study(argument), options);
    if (result.contains("pareto")) {
        print_fronts(result, out);
        print_limits(result.at("context").at("voxspring").at("limits"), out);
        print_unmeasured(result, out);
    } else if (result.contains("fastest")) {
        print_fastest(result, out);
    } else if (result.contains("stability")) {
        print_stability(result, out);
        print_unmeasured(result, out);
    } else if (result.contains("stress")) {
        print_stress(result, out);
        print_unmeasured(result, out);
    } else {
        print_table(result, out);
    }
    if (options.out) out << "written: " << options.out->string() << "\n";
    if (is_unfinished(result)) {
        out << "interrupted: this is what was finished"
            << (options.out ? "; the same command with --resume goes on" : "") << "\n";
        return interrupted_exit_code;
    }
    return result.at("failed").empty() ? 0 : 1;
}

}  // namespace voxspring
