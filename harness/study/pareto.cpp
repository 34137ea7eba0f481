#include "harness/study/pareto.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>

#include "harness/base/bad_input.h"
#include "harness/base/text.h"
#include "harness/device/noise.h"
#include "harness/results/result.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/divergence.h"
#include "harness/verification/errors.h"

namespace voxspring {
namespace {

/// Repetitions of a run stop once they have taken that long together.
constexpr double most_seconds = 1;
/// A run as long as that is its own warm-up.
constexpr double long_run_seconds = 0.25;

double steps_of(const TimeSteps& time_steps, double fraction) {
    return std::round(time_steps.steps * (time_steps.fractions.front() / fraction));
}

/// What rows call the device: the same card has one name whatever the API.
std::string device_of(const nlohmann::json& capabilities, std::map<std::string, std::string>& by_uuid) {
    const std::string uuid = capabilities.at("uuid"), device = capabilities.at("device");
    return uuid.empty() ? device : by_uuid.emplace(uuid, device).first->second;
}

struct Timed {
    std::vector<double> seconds;
    State last;
    std::optional<Divergence> divergence;
};

Timed time_runs(Backend& backend, const Scene& scene, const DivergenceMonitor& monitor, int steps,
                int repetitions) {
    SceneRunner runner(scene);
    Timed timed;
    backend.monitor(monitor);
    const auto once = [&] {
        runner.rewind(backend);
        const double seconds = backend.timed([&] { runner.run(backend, steps); }).device_seconds;
        timed.divergence = backend.divergence();
        return seconds;
    };
    double total = once();
    if (total > long_run_seconds) {
        timed.seconds.push_back(total);
    } else {
        total = 0;
    }
    while (!timed.divergence && int(timed.seconds.size()) < repetitions && total < most_seconds) {
        timed.seconds.push_back(once());
        total += timed.seconds.back();
    }
    timed.last = backend.download();
    timed.divergence = find_divergence(backend, runner, monitor, timed.last, steps);
    return timed;
}

/// The end time, which all time steps reach.
Span span_of(const Scene& scene, const TimeSteps& time_steps) {
    return {time_steps.fractions.front() * scene.stable_time_step, time_steps.steps};
}

/// Runs one time step after another, in the case's process.
class ParetoRunner : public CaseRunner {
public:
    ParetoRunner(const Scene& scene, const TimeSteps& time_steps, SharedState& shared)
        : scene_(scene), time_steps_(time_steps), shared_(shared) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        const int steps = question.at("steps");
        const Scene stepped = in_steps(scene_, span_of(scene_, time_steps_), steps);
        const DivergenceMonitor monitor = divergence_monitor(stepped, steps);
        const Timed timed = time_runs(backend, stepped, monitor, steps, time_steps_.repetitions);
        nlohmann::json answer = {{"state", shared_.put(timed.last)}, {"seconds", timed.seconds}};
        if (timed.divergence) answer["diverged"] = describe(*timed.divergence, monitor);
        return answer;
    }

private:
    const Scene& scene_;
    const TimeSteps time_steps_;
    SharedState& shared_;
};

/// A time step of a scene, and what its runs are held against.
struct Step {
    const Scene& scene;
    const Scene& stepped;
    const ReferenceSolution& solution;
    SharedState& state;
};

/// One row, without its device; or, in `reason` alone, why there is none.
nlohmann::json run_step(Case& benchmark_case, const Step& step) {
    const Scene& scene = step.scene;
    const Scene& stepped = step.stepped;
    const int steps = step.solution.steps;
    nlohmann::json row = row_identity(scene.name, benchmark_case.spec());
    const nlohmann::json timed =
        benchmark_case.ask({{"do", "run"}, {"steps", steps}}, "running " + std::to_string(steps) + " steps");
    const State last = step.state.take(timed.at("state"));
    const Comparison comparison = judge(step.solution, last, benchmark_case.spec());
    const bool diverged = timed.contains("diverged");
    if (!diverged && !comparison.passed())
        throw std::runtime_error("does not agree with cpu_reference: " + comparison.reason + " (in " +
                                 std::to_string(steps) + " steps)");
    row["particles"] = scene.problem.particle_count();
    row["springs"] = count_springs(scene.problem).total();
    row["time_step"] = stepped.problem.time_step;
    row["fraction_of_stable"] = stepped.problem.time_step / scene.stable_time_step;
    row["steps"] = steps;
    row["diverged"] = diverged;
    row["on_front"] = false;
    if (diverged) {
        row["seconds"] = nullptr;
        row["reason"] = timed.at("diverged");
        row.update(no_error_fields(step.solution));
    } else {
        const std::vector<double> seconds = timed.at("seconds");
        row["seconds"] = median(seconds);
        if (const auto noise = reasons_of_noise({.seconds = seconds}); !noise.empty()) row["noisy"] = noise;
        row.update(error_fields(step.solution, last, comparison));
    }
    return row;
}

bool usable(const nlohmann::json& row) {
    return row.at("seconds").is_number() && row.at("total_error_relative_l2").is_number();
}

}  // namespace

void check_pareto(const Scene& scene, const TimeSteps& time_steps) {
    if (!scene.edits.empty())
        throw BadInput("scene " + scene.name, "edits", std::to_string(scene.edits.size()) + " edits",
                       "none in a pareto study: springs that change make the order in time one");
    if (!std::isfinite(scene.stable_time_step))
        throw BadInput("scene " + scene.name, "stable time step", "infinite", "a scene with springs");
    constexpr int most_steps = std::numeric_limits<int>::max() / 2;  // references take twice as many
    if (steps_of(time_steps, time_steps.fractions.back()) > double(most_steps))
        throw BadInput("scene " + scene.name, "time_steps", std::to_string(time_steps.fractions.back()),
                       "fractions that take at most " + std::to_string(most_steps) + " steps");
}

MakeCaseRunner pareto_runner(const Scene& scene, const TimeSteps& time_steps, SharedState& state) {
    return [&scene, time_steps, &state](const BackendSpec&) {
        return std::make_unique<ParetoRunner>(scene, time_steps, state);
    };
}

SceneResult measure_pareto(const Scene& scene, std::vector<Case>& cases, const TimeSteps& time_steps,
                           SharedState& state, References& references, const OnRepetition& on_repetition) {
    const Span span = span_of(scene, time_steps);
    std::vector<int> counts;
    for (const double fraction : time_steps.fractions) counts.push_back(int(steps_of(time_steps, fraction)));
    const int total = int(counts.size() * cases.size());
    on_repetition("float64 references", 0, total);
    const Refined refined = references.refined(scene, span, counts);
    const Chaos chaos = references.chaos(in_steps(scene, span, counts.front()), counts.front());

    SceneResult result;
    std::vector<nlohmann::json>& rows = result.lists["pareto"];
    std::map<std::string, std::string> by_uuid;
    int begun = 0;
    for (const int steps : counts) {
        const Scene stepped = in_steps(scene, span, steps);
        ReferenceSolution solution{stepped.problem, steps, references.after(stepped, steps), refined, chaos};
        solution.conserved = conserved(solution.problem, solution.same_step);
        const std::string name = "row of " + std::to_string(steps) + " steps";
        for (Case& benchmark_case : cases) {
            ++begun;
            JournalScope& scope = benchmark_case.scope();
            if (scope.find(name) == nullptr && scope.find("failed") == nullptr) {
                on_repetition(benchmark_case.spec().label(), begun, total);
                const auto failure = failure_of([&] {
                    scope.keep(name, run_step(benchmark_case, {scene, stepped, solution, state}));
                });
                if (failure) scope.keep("failed", *failure);
            }
            if (scope.find(name) == nullptr) continue;
            rows.push_back(*scope.find(name));
            rows.back()["device"] = device_of(benchmark_case.capabilities(), by_uuid);
            rows.back()["end_time"] = span.time_step * span.steps;
        }
    }
    add_failures(result, scene.name, cases);
    mark_fronts(rows);
    return result;
}

void mark_fronts(std::vector<nlohmann::json>& rows) {
    std::map<std::string, std::vector<nlohmann::json*>> of_device;
    for (nlohmann::json& row : rows) {
        if (usable(row)) of_device[row.at("device")].push_back(&row);
    }
    for (auto& [device, all] : of_device) {
        std::stable_sort(all.begin(), all.end(), [](const auto* a, const auto* b) {
            const auto key = [](const nlohmann::json& row) {
                return std::pair(row.at("seconds").get<double>(),
                                 row.at("total_error_relative_l2").get<double>());
            };
            return key(*a) < key(*b);
        });
        double smallest = std::numeric_limits<double>::infinity();
        for (nlohmann::json* row : all) {
            const double error = row->at("total_error_relative_l2");
            (*row)["on_front"] = error < 0.99 * smallest;
            smallest = std::min(smallest, error);
        }
    }
}

void print_fronts(const nlohmann::json& result, std::ostream& out) {
    std::vector<std::string> order;
    std::map<std::string, std::vector<nlohmann::json>> fronts;
    std::vector<std::string> diverged;
    std::map<std::string, std::string> without_total;
    for (const auto& row : result.at("pareto")) {
        const std::string scene = row.at("scene"), device = row.at("device");
        const std::string place = scene + " on " + device;
        if (row.at("diverged").get<bool>()) {
            std::ostringstream text;
            text << scene << " " << case_label(row) << " at " << row.at("fraction_of_stable").get<double>()
                 << " of the stable time step " << row.at("reason").get<std::string>();
            diverged.push_back(text.str());
        } else if (row.at("total_error_reason").is_string()) {
            without_total[scene] = row.at("total_error_reason");
        }
        if (!row.at("on_front").get<bool>()) continue;
        if (!fronts.contains(place)) order.push_back(place);
        fronts[place].push_back(row);
    }
    for (const std::string& place : order) {
        auto& rows = fronts[place];
        std::sort(rows.begin(), rows.end(), [](const auto& a, const auto& b) {
            return a.at("seconds").template get<double>() < b.at("seconds").template get<double>();
        });
        out << place << ", to time " << rows.front().at("end_time").get<double>() << "\n";
        std::vector<std::vector<std::string>> table = {
            {"  backend", "run time", "total error", "rounding error", "time step", "of stable", "steps"}};
        for (const auto& row : rows) {
            std::ostringstream time_step, fraction;
            time_step << std::setprecision(3) << row.at("time_step").get<double>();
            fraction << std::setprecision(3) << row.at("fraction_of_stable").get<double>();
            table.push_back({"  " + case_label(row), noise_mark(row) + si(row.at("seconds"), "s"),
                             error_text(row.at("total_error_relative_l2")),
                             error_text(row.at("error_relative_l2")), time_step.str(), fraction.str(),
                             std::to_string(row.at("steps").get<int>())});
        }
        print_aligned(table, out, 1);
    }
    print_noise(result.at("pareto"), out);
    for (const auto& [scene, reason] : without_total)
        out << "no total error: " << scene << ": " << reason << "\n";
    for (const std::string& text : diverged) out << text << "\n";
}

}  // namespace voxspring
