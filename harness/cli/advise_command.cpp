#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/interruption.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/results/result.h"
#include "harness/scene/scene.h"
#include "harness/study/advise.h"
#include "harness/study/pareto.h"
#include "harness/study/study.h"

namespace voxspring {

int print_advice(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    std::vector<Candidate> candidates;
    std::string scene;
    if (options.results) {
        scene = argument;
        candidates = candidates_of(read_json(*options.results), scene);
    } else {
        scene = load_scene(argument).name;
        StudyOptions study = options.study;
        study.scenes = {argument};
        study.stops_at_once = true;
        const nlohmann::json result = run_study(load_study("pareto"), study);
        if (is_unfinished(result)) return interrupted_exit_code;
        print_unmeasured(result, out);
        candidates = candidates_of(parse_json(result.dump(), "what was measured"), scene);
    }
    if (candidates.empty()) {
        out << "no run of " << scene
            << " has an error against the converged solution: float64 does not converge, or all diverged\n";
        return 1;
    }
    const auto print = [&](const std::string& heading, const Candidate& candidate) {
        out << heading << ": " << specification(candidate) << "\n    on " << candidate.device
            << fmt::format(
                   "\n    time step {:.4g} ({:.4g} of the stable one): {} for {} steps to time {:.4g}",
                   candidate.time_step, candidate.fraction_of_stable, si(candidate.seconds, "s"),
                   candidate.steps, candidate.end_time)
            << "\n    error against the converged solution " << error_text(candidate.total_error)
            << ", of it rounding " << error_text(candidate.rounding_error) << "\n";
    };
    const Advice advice = advise(candidates, options.error);
    if (!advice.best) {
        out << scene << ": nothing reaches an error of " << options.error << "\n";
        print("most accurate", advice.most_accurate);
        return 1;
    }
    out << scene << ": an error of " << options.error << " is reached soonest by\n";
    print("best", *advice.best);
    for (const Candidate& candidate : advice.runners_up) print("runner-up", candidate);
    return 0;
}

}  // namespace voxspring
