// The kind of study `pareto`: run time to a fixed end time against error, over time steps.
#include "harness/study/kinds/pareto.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/device/limits.h"
#include "harness/device/noise.h"
#include "harness/results/capabilities.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/measure.h"
#include "harness/study/study_kind.h"
#include "harness/verification/divergence.h"
#include "harness/verification/errors.h"

namespace voxspring {
namespace {

/// The sort key of a row: time, then error against the converged solution. The row must have both.
std::pair<double, double> key_of(const ParetoRow& row) {
    return {*row.seconds, *row.errors->total_relative_l2};
}

std::string digits(double value) { return fmt::format("{:.3g}", value); }

void print_front(std::vector<ParetoRow> rows, std::ostream& out, TableWidth width) {
    std::sort(rows.begin(), rows.end(),
              [](const ParetoRow& a, const ParetoRow& b) { return a.seconds < b.seconds; });
    print_cells<ParetoRow>(
        rows,
        {{{"  backend", 0, true}, [](const auto& row) { return "  " + row.label(); }},
         {{"run time"}, [](const auto& row) { return row.noise_mark() + si(*row.seconds, "s"); }},
         {{"error against the converged solution"},
          [](const auto& row) { return error_cell(row.errors->total_relative_l2); }},
         {{"rounding error", 1}, [](const auto& row) { return error_cell(row.errors->relative_l2); }},
         {{"time step", 2}, [](const auto& row) { return digits(row.time_step); }},
         {{"of stable", 4}, [](const auto& row) { return digits(row.fraction_of_stable); }},
         {{"steps", 3}, [](const auto& row) { return std::to_string(row.workpiece->steps); }}},
        width, out);
}

/// Prints the front of each scene and device, fastest first, then the reasons not to trust times, the scenes
/// without an error against the converged solution, and the runs that diverged.
void print_fronts(const Result& result, std::ostream& out, TableWidth width) {
    std::vector<std::string> order, diverged;
    std::map<std::string, std::vector<ParetoRow>> fronts;
    std::map<std::string, std::string> without_total;
    std::vector<Row> all;
    for (const ParetoRow& one : result.rows<ParetoRow>("pareto")) {
        const Row& row = one;
        all.push_back(row);
        const std::string place = row.identity.scene + " on " + one.device;
        if (one.diverged) {
            diverged.push_back(row.identity.scene + " " + row.label() + " at " +
                               digits(one.fraction_of_stable) + " of the stable time step " +
                               row.reason.value_or(""));
        } else if (row.errors->total_reason) {
            without_total[row.identity.scene] = *row.errors->total_reason;
        }
        if (!one.on_front) continue;
        if (!fronts.contains(place)) order.push_back(place);
        fronts[place].push_back(one);
    }
    for (const std::string& place : order) {
        out << place << ", to time " << fronts[place].front().end_time << "\n";
        print_front(fronts[place], out, width);
    }
    print_noise(all, out);
    for (const auto& [scene, reason] : without_total)
        out << "no error against the converged solution: " << scene << ": " << reason << "\n";
    for (const std::string& text : diverged) out << text << "\n";
}

/// No further repetition of a run begins once all of them together have taken this many seconds.
constexpr double max_seconds = 1;
/// A first run that takes more seconds than this counts as a repetition: it needs no separate warm-up.
constexpr double long_run_seconds = 0.25;

/// The device's name in rows. If APIs name a card differently, rows have the name that came first, kept in
/// `by_uuid`.
std::string device_of(const Capabilities& capabilities, std::map<std::string, std::string>& by_uuid) {
    const std::string& device = capabilities.device;
    return capabilities.uuid.empty() ? device : by_uuid.emplace(capabilities.uuid, device).first->second;
}

// --- In the process of a case ---------------------------------------------------------------------------

struct TimedRuns {
    std::vector<double> seconds;
    State last;
    std::optional<Divergence> divergence;
};

TimedRuns time_runs(Backend& backend, const Scene& scene, const DivergenceMonitor& monitor, int steps,
                    int repetitions) {
    SceneRunner runner(scene);
    TimedRuns timed;
    backend.monitor({});  // an earlier run that diverged may have left its monitor
    const auto once = [&] {
        runner.rewind(backend);
        return backend.timed([&] { runner.run(backend, steps); }).device_seconds;
    };
    double total = once();
    if (total > long_run_seconds) {
        timed.seconds.push_back(total);
    } else {
        total = 0;
    }
    while (int(timed.seconds.size()) < repetitions && total < max_seconds) {
        timed.seconds.push_back(once());
        total += timed.seconds.back();
    }
    timed.last = backend.download();
    // Divergence is found from the last state, since checks during the runs would be timed.
    timed.divergence = find_divergence(backend, runner, monitor, timed.last, steps);
    return timed;
}

/// Runs the scene at one time step after another.
class ParetoRunner : public CaseRunner {
public:
    ParetoRunner(const BackendSpec&, const Scene& scene, const nlohmann::json& parameters,
                 SharedState* shared)
        : scene_(scene),
          span_{parameters.at("time_step"), parameters.at("steps")},
          repetitions_(parameters.at("repetitions")),
          shared_(*shared) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        const int steps = question.at("steps");
        if (question.at("do") == "compile") return compile(backend, steps);
        const Scene stepped = in_steps(scene_, span_, steps);
        const DivergenceMonitor monitor = divergence_monitor(stepped, steps);
        const TimedRuns timed = time_runs(backend, stepped, monitor, steps, repetitions_);
        nlohmann::json answer = {{"state", shared_.put(timed.last)}, {"seconds", timed.seconds}};
        if (timed.divergence) answer["diverged"] = describe(*timed.divergence, monitor);
        return answer;
    }

private:
    /// Makes one step of a run of `steps` steps, so that the backend compiles what it needs.
    nlohmann::json compile(Backend& backend, int steps) const {
        const Scene stepped = in_steps(scene_, span_, steps);
        SceneRunner runner(stepped);
        runner.rewind(backend);
        runner.run(backend, 1);
        backend.synchronize();
        return nullptr;
    }

    const Scene& scene_;
    const Span span_;
    const int repetitions_;
    SharedState& shared_;
};

const RegisteredCaseRunner pareto_runner("pareto", case_runner_of<ParetoRunner>);

// --- In the process of the study ------------------------------------------------------------------------

/// A time step of a scene, and the reference for its runs.
struct Step {
    const Scene& scene;
    const Scene& stepped;
    const ReferenceSolution& solution;
    double end_time;
    SharedState& state;
};

std::string name_of_row(int steps) { return "row of " + counted(std::uint64_t(steps), "step"); }

/// Makes every case compile its kernels, several cases at once. The compiled code serves every time step.
void compile_all(StudyBench& bench, std::vector<Case>& cases, int steps, int total) {
    std::vector<bool> compiles(cases.size());
    const auto attempt = [&](Case& one, const std::function<void()>& action) {
        const auto failure = failure_of(action);
        // In a shared process another case may be at fault. Then the first run shows whether this case fails.
        if (failure && !one.shares_process()) one.scope().keep("failed", *failure);
    };
    at_once(
        cases.size(), bench.side_by_side(),
        [&](std::size_t n) {
            Case& one = cases[n];
            const bool known = one.scope().find(name_of_row(steps)) != nullptr;
            if (known || one.scope().find("failed") != nullptr || interrupted()) return;
            bench.show("compiling " + one.spec().label(), 0, total);
            attempt(one, [&] {
                one.begin({{"do", "compile"}, {"steps", steps}});
                compiles[n] = true;
            });
        },
        [&](std::size_t n) {
            if (compiles[n]) attempt(cases[n], [&] { (void)cases[n].finish("compiling"); });
        });
}

/// Measures one row. Throws what the case throws, and std::runtime_error if the last state of a run that did
/// not diverge does not agree with the reference.
ParetoRow run_step(const StudyBench& bench, Case& benchmark_case, const Step& step,
                   const std::string& device) {
    const Scene& scene = step.scene;
    const int steps = step.solution.steps;
    const nlohmann::json timed = benchmark_case.ask({{"do", "run"}, {"steps", steps}},
                                                    "running " + counted(std::uint64_t(steps), "step"));
    State last;
    step.state.take(timed.at("state"), last);
    const JudgedState comparison = judge(step.solution, last, benchmark_case.spec());
    ParetoRow one;
    bench.identify(one, benchmark_case.spec(), steps);
    one.device = device;
    one.time_step = step.stepped.problem.time_step;
    one.fraction_of_stable = one.time_step / scene.stable_time_step;
    one.end_time = step.end_time;
    one.diverged = timed.contains("diverged");
    if (!one.diverged && !comparison.passed())
        throw std::runtime_error("does not agree with float64: " + comparison.reason + " (in " +
                                 counted(std::uint64_t(steps), "step") + ")");
    if (one.diverged) {
        one.reason = timed.at("diverged").get<std::string>();
        one.errors = no_errors(step.solution, benchmark_case.spec());
    } else {
        const std::vector<double> seconds = timed.at("seconds");
        one.seconds = median(seconds);
        one.repetitions = int(seconds.size());
        one.noisy = reasons_of_noise({.seconds = seconds});
        one.errors = errors_of(step.solution, last, comparison, benchmark_case.spec());
    }
    return one;
}

class ParetoStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        for (const JsonValue& item :
             study.require("time_steps", "fractions of the stable time step").array(1, 64)) {
            fractions_.push_back(item.number(1e-6, 1));
            if (fractions_.size() > 1 && fractions_.back() >= fractions_[fractions_.size() - 2])
                item.refuse("fractions of the stable time step in descending order");
        }
    }
    void check(const Study&, const StudyScene& item, const Scene& scene) const override {
        const std::string where = "scene " + scene.name;
        if (!scene.edits.empty())
            throw BadInput(
                where, "edits", counted(scene.edits.size(), "edit"),
                "no edits in a pareto study: with edits the error falls only with the first power of "
                "the time step");
        if (!std::isfinite(scene.stable_time_step))
            throw BadInput(where, "stable time step", "infinite", "a scene with springs");
        if (steps_at(fractions_.back(), item) > max_steps_in_all)
            throw BadInput(
                where, "time_steps", fmt::format("{:g}", fractions_.back()),
                "fractions with which a run takes at most " + std::to_string(max_steps_in_all) + " steps");
        // Runs of as many steps have the same time step, whatever the fractions say.
        for (std::size_t n = 1; n < fractions_.size(); ++n) {
            if (steps_at(fractions_[n], item) == steps_at(fractions_[n - 1], item))
                throw BadInput(where, "time_steps", fmt::format("{:g}", fractions_[n]),
                               fmt::format("fractions with which runs take different numbers of steps: with "
                                           "\"steps\": {} a run at {:g} takes as many",
                                           item.steps, fractions_[n - 1]));
        }
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return int(fractions_.size()); }
    double steps_of_case(const Study& study, const StudyScene& item) const override {
        double steps = 0;
        for (const double fraction : fractions_) steps += steps_at(fraction, item);
        return steps * study.repetitions;
    }
    void run(StudyBench& bench) override {
        std::vector<int> counts;
        for (const double fraction : fractions_) counts.push_back(int(steps_at(fraction, bench.item())));
        std::map<int, std::vector<ParetoRow>> rows_of;
        try {
            measure(bench, counts, rows_of);
        } catch (const Interrupted&) {
            // The result has the rows that were finished before the interruption.
        }
        std::vector<ParetoRow> rows;
        for (const int steps : counts) rows.insert(rows.end(), rows_of[steps].begin(), rows_of[steps].end());
        mark_fronts(rows);
        for (const ParetoRow& row : rows) bench.add("pareto", row);
    }
    void make_lists(Result& result) const override { result.rows<ParetoRow>("pareto"); }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_fronts(result, out, width);
        print_limits(result.own_context().at("limits"), out);
        print_unmeasured(result, out);
    }

private:
    /// The number of steps until the end time, which is the same for all runs: the end of `item.steps` steps
    /// at the first fraction.
    double steps_at(double fraction, const StudyScene& item) const {
        return std::round(item.steps * (fractions_.front() / fraction));
    }
    /// Measures with each number of steps in `counts`, and adds the rows to `rows_of` by that number. Throws
    /// Interrupted; rows added before are valid.
    void measure(StudyBench& bench, const std::vector<int>& counts,
                 std::map<int, std::vector<ParetoRow>>& rows_of) const {
        const Scene& scene = bench.scene();
        const Span span{fractions_.front() * scene.stable_time_step, bench.item().steps};
        SharedState state(scene.problem.particle_count());
        const CaseProgram program{"pareto",
                                  {{"time_step", span.time_step},
                                   {"steps", span.steps},
                                   {"repetitions", bench.study().repetitions}},
                                  &state};
        const auto total = [&] { return int(counts.size()) * bench.expected_cases(); };
        std::optional<Refined> refined;
        std::map<std::string, std::string> by_uuid;
        int begun = 0;
        for (const std::vector<BackendSpec>& group : bench.groups()) {
            std::vector<Case> cases = bench.enter_all(group, program, {.at_once = true});
            if (cases.empty()) continue;
            compile_all(bench, cases, counts.front(), total());
            if (!refined) {
                bench.show("float64 references", 0, total());
                refined = bench.references().refined(scene, span, counts);
            }
            for (const int steps : counts) {
                if (interrupted()) throw Interrupted();
                const Scene stepped = in_steps(scene, span, steps);
                ReferenceSolution solution{stepped.problem, steps, bench.references().after(stepped, steps),
                                           *refined, stepped.state};
                // Backends are judged at the largest time step only (error_threshold.h). At smaller ones the
                // effect of rounding is what the study measures, spreads would take as long as the rest of
                // the study, and the backends run the same code as at the largest.
                if (steps == counts.front()) add_spreads(bench, stepped, specs_of(cases), solution);
                const Step step{scene, stepped, solution, span.time_step * span.steps, state};
                for (Case& one : cases) {
                    bench.show(one.spec().label(), begun++, total());
                    const std::string device = device_of(capabilities_of(one.capabilities()), by_uuid);
                    const nlohmann::json* row = one.kept(
                        name_of_row(steps), [&] { return json_of(run_step(bench, one, step, device)); });
                    if (row != nullptr) rows_of[steps].push_back(row_of_json<ParetoRow>(*row));
                }
            }
            for (Case& one : cases) {
                bench.add_failure(one);
                one.dismiss();
            }
        }
    }

    std::vector<double> fractions_;  ///< time steps as fractions of the stable one, descending
};

const RegisteredStudyKind pareto_kind("pareto", [] { return std::make_unique<ParetoStudy>(); });

}  // namespace

void mark_fronts(std::vector<ParetoRow>& rows) {
    std::map<std::string, std::vector<ParetoRow*>> of_device;
    for (ParetoRow& row : rows) {
        if (row.seconds && row.errors && row.errors->total_relative_l2) of_device[row.device].push_back(&row);
    }
    for (auto& [device, all] : of_device) {
        std::stable_sort(all.begin(), all.end(),
                         [](const auto* a, const auto* b) { return key_of(*a) < key_of(*b); });
        double smallest = std::numeric_limits<double>::infinity();
        for (ParetoRow* row : all) {
            const double error = key_of(*row).second;
            row->on_front = error < 0.99 * smallest;
            smallest = std::min(smallest, error);
        }
    }
}

}  // namespace voxspring
