#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/choice/advise.h"
#include "harness/cli/commands.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene.h"
#include "harness/study/kinds/pareto.h"
#include "harness/study/kinds/truth.h"
#include "harness/study/scaling_row.h"
#include "harness/study/study.h"
#include "harness/study/study_kind.h"

namespace voxspring {

namespace {

/// Runs a study on one scene. Prints what could not be measured to `out`, or to standard error if the advice
/// is JSON.
Result measured(const std::string& study, const std::string& scene, const AdviseOptions& options,
                std::ostream& out) {
    StudyOptions of_study = options.study;
    of_study.scenes = {scene};
    Result result = run_study(load_study(study), of_study);
    print_unmeasured(result, options.json ? std::cerr : out);
    return result;
}

/// The name of the scene `argument` in results. Results name a file without its folder.
std::string name_in_results(const std::string& argument) {
    return utf8_text(std::filesystem::path(argument).filename().string());
}

/// The command that repeats the run of a candidate. Its time step has all digits, so that the run is the same
/// to the last bit.
std::string command_of(const Candidate& candidate, const std::string& argument,
                       const AdviseOptions& options) {
    return fmt::format("{} --time-step {} --steps {} --out state.npz",
                       run_command_of(argument, options.study.volume, specification(candidate)),
                       candidate.time_step, candidate.steps);
}

nlohmann::json to_json(const Candidate& candidate, const std::string& command) {
    return {{"backend", candidate.backend},
            {"formulation", candidate.formulation},
            {"precision", candidate.precision},
            {"tuning", candidate.tuning},
            {"device", candidate.device},
            {"time_step", candidate.time_step},
            {"fraction_of_stable", candidate.fraction_of_stable},
            {"steps", candidate.steps},
            {"end_time", candidate.end_time},
            {"seconds", candidate.seconds},
            {"total_error_relative_l2", candidate.total_error},
            {"error_relative_l2", candidate.rounding_error},
            {"command", command}};
}

void print(const Candidate& candidate, std::ostream& out) {
    const std::string tuning = changed_tuning(candidate);
    out << fmt::format("  {}{}, {} in {}, on {}\n", candidate.backend,
                       tuning.empty() ? "" : " with " + tuning, candidate.formulation, candidate.precision,
                       candidate.device)
        << fmt::format("    {} for {} steps of {:.4g} ({:.3g} of the stable time step) to time {:.4g}\n",
                       si(candidate.seconds, "s"), candidate.steps, candidate.time_step,
                       candidate.fraction_of_stable, candidate.end_time)
        << fmt::format("    error against the converged solution {}; rounding alone {}\n",
                       error_text(candidate.total_error), error_text(candidate.rounding_error));
}

int print_advice_on_errors(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    std::string scene = name_in_results(argument);
    std::vector<Candidate> candidates;
    bool unfinished = false;
    if (options.results) {
        candidates = candidates_of(read_json(*options.results), scene);
    } else {
        scene = load_scene(argument, options.study.volume).name;
        const Result result = measured("pareto", argument, options, out);
        unfinished = is_unfinished(result);
        if (!unfinished || !result.rows<ParetoRow>("pareto").empty())
            candidates = candidates_of(parse_json(json_text(result), "what was measured"), scene);
    }
    const double error = options.error.value();
    if (candidates.empty()) {
        (options.json ? std::cerr : out)
            << scene << ": "
            << (unfinished ? "interrupted before anything was measured"
                           : "the error of every run is unknown: there is no converged solution, or "
                             "all runs diverged")
            << "\n";
        return unfinished ? interrupted_exit_code : 1;
    }
    const Advice advice = advise(candidates, error);
    const Candidate& first = advice.best ? *advice.best : advice.most_accurate;
    const std::string command = command_of(first, argument, options);
    const int exit_code = unfinished ? interrupted_exit_code : advice.best ? 0 : 1;
    if (options.json) {
        const auto json_of = [&](const Candidate& candidate) {
            return to_json(candidate, command_of(candidate, argument, options));
        };
        nlohmann::json best, runners_up = nlohmann::json::array();
        if (advice.best) best = json_of(*advice.best);
        for (const Candidate& candidate : advice.runners_up) runners_up.push_back(json_of(candidate));
        const nlohmann::json json = {
            {"scene", scene}, {"error", error},           {"unfinished", unfinished},
            {"best", best},   {"runners_up", runners_up}, {"most_accurate", json_of(advice.most_accurate)}};
        out << json_text(json, 2) << "\n";
        return exit_code;
    }
    if (unfinished)
        out << scene << ": interrupted; the advice follows from " << candidates.size() << " runs\n";
    out << scene << ": "
        << (advice.best ? fmt::format("an error of {:g} is reached soonest by\n", error)
                        : fmt::format("nothing reaches an error of {:g}; the most accurate is\n", error));
    print(first, out);
    if (!advice.runners_up.empty()) out << "runners-up\n";
    for (const Candidate& candidate : advice.runners_up) print(candidate, out);
    out << "to run " << (advice.runners_up.empty() ? "it" : "the first of them") << "\n  " << command << "\n";
    return exit_code;
}

/// Prints that there is nothing to advise on.
void print_nothing_measured(const std::string& argument, bool unfinished, std::ostream& out) {
    out << argument << ": " << (unfinished ? "interrupted before anything" : "nothing") << " was measured\n";
}

/// Prints, before the advice of an interrupted measurement, that more was to be measured.
void print_interrupted(const std::string& argument, std::ostream& out) {
    out << argument << ": interrupted; the advice follows from what was measured\n";
}

/// Prints whether several ranks are faster than one, and the fastest row.
int print_advice_on_ranks(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    std::vector<ScalingRow> rows;
    bool unfinished = false;
    if (options.results) {
        rows = scaling_rows_of(read_json(*options.results), name_in_results(argument));
        // The result may have rows of more ranks than the user asks for.
        const int most = options.study.ranks.value_or(int(options.study.devices.size()));
        std::erase_if(rows, [&](const ScalingRow& row) { return row.ranks > most; });
    } else {
        const Result result = measured("scaling", argument, options, out);
        unfinished = is_unfinished(result);
        rows = result.rows<ScalingRow>("scaling");
    }
    if (rows.empty()) {
        print_nothing_measured(argument, unfinished, options.json ? std::cerr : out);
        return unfinished ? interrupted_exit_code : 1;
    }
    const ScalingRow& best = *std::min_element(rows.begin(), rows.end(), [](const auto& a, const auto& b) {
        return a.seconds_per_step < b.seconds_per_step;
    });
    const int exit_code = unfinished ? interrupted_exit_code : 0;
    if (options.json) {
        const nlohmann::json json = {
            {"scene", argument}, {"unfinished", unfinished}, {"best", json_of(best)}};
        out << json_text(json, 2) << "\n";
        return exit_code;
    }
    if (unfinished) print_interrupted(argument, out);
    print_what_pays(rows, out);
    out << fmt::format(
        "best: {} by {}, {} per step\n", best.label(),
        best.ranks == 1 ? "1 rank" : fmt::format("{} ranks ({}, {})", best.ranks, best.cut, best.way),
        si(best.seconds_per_step, "s"));
    return exit_code;
}

/// Prints which pitch, backend and placement of the particles (at voxels' centres or corners) reach the error
/// against the continuum in the least time.
int print_advice_on_continuum(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    (void)truth_case(argument, "command line");
    const Result result = options.results ? read_result_of("truth", read_json(*options.results), argument,
                                                           {"model_error", "seconds"})
                                          : measured("truth", argument, options, out);
    const std::vector<TruthRow>& rows = result.rows<TruthRow>("truth");
    const bool unfinished = is_unfinished(result);
    const TruthRow* best = fastest_truth(rows, argument, options.error.value());
    const TruthRow* closest = nullptr;
    for (const TruthRow& row : rows) {
        const bool asked = row.identity.scene == argument && row.strain == "small";
        if (asked && (closest == nullptr || row.model_error < closest->model_error)) closest = &row;
    }
    const int exit_code = unfinished ? interrupted_exit_code : best != nullptr ? 0 : 1;
    if (options.json) {
        const auto json_or_null = [](const TruthRow* row) {
            return row == nullptr ? nlohmann::json() : json_of(*row);
        };
        const nlohmann::json json = {{"scene", argument},
                                     {"error", *options.error},
                                     {"unfinished", unfinished},
                                     {"best", json_or_null(best)},
                                     {"most_accurate", json_or_null(closest)}};
        out << json_text(json, 2) << "\n";
        return exit_code;
    }
    const TruthRow* shown = best != nullptr ? best : closest;
    if (shown == nullptr) {
        print_nothing_measured(argument, unfinished, out);
        return exit_code;
    }
    if (unfinished) print_interrupted(argument, out);
    out << argument << ": "
        << (best != nullptr
                ? fmt::format("an error of {:g} against the continuum is reached soonest by\n",
                              *options.error)
                : fmt::format(
                      "nothing reaches an error of {:g} against the continuum; the most accurate is\n",
                      *options.error))
        << fmt::format(
               "  {}, particles at {}, {} voxels across, time steps of {:g} of the stable one\n"
               "    {} for {} steps until rest; error {}; order of convergence {} from the coarsest pitch\n",
               shown->label(), shown->particles_at, shown->across, shown->time_step_fraction,
               si(shown->seconds, "s"), shown->workpiece->steps, percent_text(shown->model_error),
               shown->order ? fixed_text(*shown->order, 2) : "-");
    return exit_code;
}

}  // namespace

int print_advice(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    const bool asks_for_ranks = options.study.ranks || !options.study.devices.empty();
    if (!asks_for_ranks && !options.error)
        throw BadInput("command line", "--error", missing,
                       "the largest acceptable error, or --ranks or --devices instead");
    if (asks_for_ranks && options.error)
        throw BadInput(
            "command line", "--error", fmt::format("{:g}", *options.error),
            "no --error with --ranks or --devices, which ask if several ranks are faster than one");
    if (asks_for_ranks && options.continuum)
        throw BadInput("command line", "--continuum", "with --ranks or --devices",
                       "--continuum with --error, or --ranks or --devices without --continuum");
    if (options.continuum) return print_advice_on_continuum(argument, options, out);
    return asks_for_ranks ? print_advice_on_ranks(argument, options, out)
                          : print_advice_on_errors(argument, options, out);
}

}  // namespace voxspring
