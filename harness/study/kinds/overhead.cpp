// The kind of study `overhead`: the cost of a step apart from its work, if the host hands steps over one by
// one or many at once. The state that the timed repetitions left is judged.
#include <algorithm>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/interruption.h"
#include "harness/base/text.h"
#include "harness/results/capabilities.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/measure.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

/// The numbers of steps for which the host's time is measured: so few that no call has to wait for the
/// device.
constexpr int unhindered_one_by_one = 50;
constexpr int unhindered_at_once = 500;

struct OverheadRow : Row {
    std::string handed_over = {};  ///< "one by one" or "at once"

    static void fields(auto& row, auto& of) { of.required("handed_over", row.handed_over); }
};

// --- In the process of a case ---------------------------------------------------------------------------

class OverheadRunner final : public CaseRunner {
public:
    OverheadRunner(const BackendSpec&, const Scene& scene, const nlohmann::json& parameters,
                   SharedState* shared)
        : steps_(parameters.at("steps")),
          repetitions_(parameters.at("repetitions")),
          shared_(*shared),
          runner_(scene) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        if (!keeps_start_) {
            runner_.rewind(backend);
            runner_.keep_start(backend);
            keeps_start_ = true;
        }
        const bool at_once = question.at("handed_over") == "at once";
        OverheadRow row;
        row.handed_over = question.at("handed_over");
        // The time from the first call to the end of the last step, divided by the steps.
        row.counters.add("seconds_per_step", shortest(backend, steps_, at_once).second, Unit::second,
                         Better::less);
        const nlohmann::json left = shared_.put(backend.download());
        const int unhindered = at_once ? unhindered_at_once : unhindered_one_by_one;
        row.counters.add("host_seconds_per_step", shortest(backend, unhindered, at_once).first, Unit::second,
                         Better::less);
        return {{"row", json_of(row)}, {"left", left}};
    }

private:
    /// Seconds per step: `first` for the calls alone, `second` until the last step is done. Each is the least
    /// of the repetitions after the first one, which includes work that only a first run does. Throws if a
    /// deterministic backend does not leave the same bits each time; judging the last state then judges all.
    std::pair<double, double> shortest(Backend& backend, int steps, bool at_once) {
        std::pair most(std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity());
        const bool comparable = backend.capabilities().deterministic;
        std::string first;
        for (int repetition = 0; repetition <= repetitions_; ++repetition) {
            runner_.rewind(backend);
            backend.synchronize();
            const auto begin = Clock::now();
            if (at_once) {
                backend.step(steps);
            } else {
                for (int n = 0; n < steps; ++n) backend.step(1);
            }
            const double called = seconds_since(begin);
            backend.synchronize();
            const double done = seconds_since(begin);
            const std::string left = comparable ? fingerprint_of(backend) : "";
            if (repetition == 0) {
                first = left;
                continue;
            }
            if (left != first)
                throw std::runtime_error(
                    "a repetition left another state than the first, from the same start");
            most = {std::min(most.first, called / steps), std::min(most.second, done / steps)};
        }
        return most;
    }

    const int steps_, repetitions_;
    SharedState& shared_;
    SceneRunner runner_;
    bool keeps_start_ = false;  // whether keep_start() has been called
};

const RegisteredCaseRunner overhead_runner("overhead", case_runner_of<OverheadRunner>);

// --- In the process of the study ------------------------------------------------------------------------

class OverheadStudy final : public StudyKind {
public:
    void check(const Study& study, const StudyScene&, const Scene& scene) const override {
        const std::string where = "study " + study.name, what = "scene " + scene.name;
        if (!scene.edits.empty())
            throw BadInput(where, what, counted(scene.edits.size(), "edit"), "no edits in an overhead study");
        // Steps that are handed over at once leave no moment to move the tool between them.
        if (!scene.tool_motion.empty())
            throw BadInput(where, what, "a tool that moves", "no tool that moves in an overhead study");
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 2; }
    double steps_of_case(const Study& study, const StudyScene& item) const override {
        return 2.0 * item.steps * (study.repetitions + 1);
    }
    void run(StudyBench& bench) override {
        const Scene& scene = bench.scene();
        const int steps = bench.item().steps;
        bench.show("float64 reference", 0, 1);
        // The reference is computed before anything is timed, since that takes all cores.
        const ReferenceSolution solution = solution_of(bench, scene, scene.problem, steps, bench.specs());
        SharedState shared(scene.problem.particle_count());
        State left;
        int done = 0;
        // One case runs after another, since nothing else may use the host or the device meanwhile.
        for (const BackendSpec& spec : bench.specs()) {
            if (interrupted()) return;
            bench.show(spec.label(), done, bench.expected_cases());
            auto entered = bench.enter(
                spec, {"overhead", {{"steps", steps}, {"repetitions", bench.study().repetitions}}, &shared});
            if (!entered) continue;
            ++done;
            for (const char* const handed_over : {"one by one", "at once"}) {
                const nlohmann::json* measured = entered->kept(handed_over, [&] {
                    const nlohmann::json answer = entered->ask(
                        {{"do", "measure"}, {"handed_over", handed_over}}, "measuring its overhead");
                    shared.take(answer.at("left"), left);
                    auto row = row_of_json<OverheadRow>(answer.at("row"));
                    const bool all = capabilities_of(entered->capabilities()).deterministic;
                    add_verdict(row, solution, left, spec, all ? bench.study().repetitions : 1);
                    return json_of(row);
                });
                if (measured == nullptr) continue;
                auto row = row_of_json<OverheadRow>(*measured);
                bench.identify(row, spec, steps);
                bench.add("overhead", row);
            }
            bench.add_failure(*entered);
        }
    }

    void make_lists(Result& result) const override { result.rows<OverheadRow>("overhead"); }

    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_rows<OverheadRow>(
            result.rows<OverheadRow>("overhead"),
            {{{"particles", 1}, [](const auto& row) { return std::to_string(row.workpiece->particles); }},
             {{"steps", 3}, [](const auto& row) { return std::to_string(row.workpiece->steps); }},
             {{"handed over"}, [](const auto& row) { return row.handed_over; }},
             {{"error", 2},
              [](const auto& row) { return error_cell(row.errors ? row.errors->max : std::nullopt); }},
             {{"threshold/motion", 4}, [](const auto& row) { return threshold_text(row.verdict); }}},
            width, out);
        print_unmeasured(result, out);
    }
};

const RegisteredStudyKind overhead_kind("overhead", [] { return std::make_unique<OverheadStudy>(); });

}  // namespace
}  // namespace voxspring
