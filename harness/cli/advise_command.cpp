#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/results/result.h"
#include "harness/scene/scene.h"
#include "harness/study/advise.h"
#include "harness/study/pareto.h"
#include "harness/study/scaling_row.h"
#include "harness/study/study.h"

namespace voxspring {

namespace {

/// A study of one scene.
nlohmann::json measured(const std::string& study, const std::string& scene, StudyOptions options,
                        std::ostream& out) {
    options.scenes = {scene};
    options.stops_at_once = true;
    nlohmann::json result = run_study(load_study(study), options);
    if (!is_unfinished(result)) print_unmeasured(result, out);
    return result;
}

/// Whether more ranks than one pay.
int print_advice_on_ranks(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    std::vector<ScalingRow> rows;
    if (options.results) {
        rows = scaling_rows_of(read_json(*options.results), argument);
    } else {
        const nlohmann::json result = measured("scaling", argument, options.study, out);
        if (is_unfinished(result)) return interrupted_exit_code;
        for (const nlohmann::json& row : result.at("scaling")) rows.push_back(scaling_row_from_json(row));
    }
    const ScalingRow* best = nullptr;
    for (const ScalingRow& row : rows) {
        if (best == nullptr || row.seconds_per_step < best->seconds_per_step) best = &row;
    }
    if (best == nullptr) {
        out << argument << ": nothing was measured\n";
        return 1;
    }
    print_what_pays(rows, out);
    out << "best: " << best->row.label() << " by "
        << (best->ranks == 1
                ? "1 rank"
                : std::to_string(best->ranks) + " ranks, cut into " + best->cut + ", and " + best->way)
        << ", " << si(best->seconds_per_step, "s") << " a step\n";
    return 0;
}

}  // namespace

int print_advice(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    const bool asks_for_ranks = options.study.ranks || !options.study.devices.empty();
    if (asks_for_ranks == options.error.has_value())
        throw BadInput("command line", "advise", asks_for_ranks ? "an error and ranks" : "neither",
                       "either --error, or --ranks or --devices");
    if (asks_for_ranks) return print_advice_on_ranks(argument, options, out);
    std::vector<Candidate> candidates;
    std::string scene;
    if (options.results) {
        scene = argument;
        candidates = candidates_of(read_json(*options.results), scene);
    } else {
        scene = load_scene(argument).name;
        const nlohmann::json result = measured("pareto", argument, options.study, out);
        if (is_unfinished(result)) return interrupted_exit_code;
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
    const Advice advice = advise(candidates, *options.error);
    if (!advice.best) {
        out << scene << ": nothing reaches an error of " << *options.error << "\n";
        print("most accurate", advice.most_accurate);
        return 1;
    }
    out << scene << ": an error of " << *options.error << " is reached soonest by\n";
    print("best", *advice.best);
    for (const Candidate& candidate : advice.runners_up) print("runner-up", candidate);
    return 0;
}

}  // namespace voxspring
