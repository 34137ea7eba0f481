// The kind of study `stress`: how backends behave at the limits of what can be simulated, on built-in scenes.
#include "harness/study/stress.h"

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "harness/results/print.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

const std::map<std::string, StressLengths> lengths_by_name = {
    {"full", StressLengths::full}, {"brief", StressLengths::brief}, {"shortest", StressLengths::shortest}};

class StressRunner final : public SuiteRunner {
public:
    StressRunner(BackendSpec spec, const nlohmann::json& parameters)
        : spec_(std::move(spec)), lengths_(lengths_by_name.at(parameters.at("lengths"))) {}

private:
    void run(Backend& backend, const nlohmann::json& known, const Once& once,
             const OnEvent& on_event) override {
        StressReferences references;
        references.take_all(known);
        references.report_to(on_event);
        run_stress(spec_, backend, lengths_, references, once);
    }

    const BackendSpec spec_;
    const StressLengths lengths_;
};

const RegisteredCaseRunner stress_runner("stress", [](const BackendSpec& spec, const Scene&,
                                                      const nlohmann::json& parameters, SharedState*) {
    return std::make_unique<StressRunner>(spec, parameters);
});

class StressStudy final : public StudyKind {
public:
    std::string scenes_key() const override { return "suites"; }
    std::string read_scene(JsonObject& item) const override {
        std::vector<std::string> names;
        for (const auto& [name, lengths] : lengths_by_name) names.push_back(name);
        (void)item.require("lengths", "full, brief or shortest").one_of(names);
        return "stress";
    }
    /// The suite makes the scenes that it runs. This placeholder is a scene that every backend takes.
    std::shared_ptr<const Scene> own_scene(const StudyScene& item) const override {
        Scene scene = load_scene("box@2");
        scene.name = item.scene;
        return std::make_shared<const Scene>(std::move(scene));
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 30; }
    /// References that the first case computes are passed on to the next ones.
    void run(StudyBench& bench) override {
        const std::string lengths = bench.item().settings.at("lengths");
        measure_suites(
            bench, {.enter =
                        [&](const BackendSpec& spec) {
                            return bench.enter(spec, {"stress", {{"lengths", lengths}}}, {.at_once = true});
                        },
                    .known = [&] { return references_.known(); },
                    .on_event = [&](const nlohmann::json& event) { references_.take(event); }});
    }
    void make_lists(Result& result) const override { result.rows<StressRow>("stress"); }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_stress(result, out, width);
        print_unmeasured(result, out);
    }

private:
    StressReferences references_;
};

const RegisteredStudyKind stress_kind("stress", [] { return std::make_unique<StressStudy>(); });

}  // namespace
}  // namespace voxspring
