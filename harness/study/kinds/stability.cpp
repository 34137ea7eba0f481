// The kind of study `stability`: the largest time step at which backends are stable.
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "harness/results/print.h"
#include "harness/study/stability_study.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

class StabilityRunner final : public SuiteRunner {
public:
    StabilityRunner(BackendSpec spec, const Scene& scene, const nlohmann::json& parameters)
        : spec_(std::move(spec)), study_(scene, limits_of(parameters)), map_(parameters.at("map")) {}

private:
    static StabilityStudy::Limits limits_of(const nlohmann::json& parameters) {
        StabilityStudy::Limits limits;
        for (const auto& limit : parameters.at("limits"))
            limits.push_back(limit.is_null() ? std::nullopt : std::optional(limit.get<double>()));
        return limits;
    }
    void run(Backend& backend, const nlohmann::json&, const Once& once, const OnEvent&) override {
        study_.run(spec_, backend, map_, once);
    }

    const BackendSpec spec_;
    StabilityStudy study_;
    const bool map_;
};

const RegisteredCaseRunner stability_runner("stability", [](const BackendSpec& spec, const Scene& scene,
                                                            const nlohmann::json& parameters, SharedState*) {
    return std::make_unique<StabilityRunner>(spec, scene, parameters);
});

class StabilityKind final : public StudyKind {
public:
    std::string read_scene(JsonObject& item) const override {
        if (const auto map = item.find("map")) (void)map->boolean();
        return StudyKind::read_scene(item);
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 7; }
    void run(StudyBench& bench) override {
        const StabilityStudy::Limits limits = StabilityStudy::limits_of(bench.scene());
        nlohmann::json listed = nlohmann::json::array();
        for (const auto& limit : limits) listed.push_back(limit ? nlohmann::json(*limit) : nlohmann::json());
        const bool empty =
            std::none_of(limits.begin(), limits.end(), [](const auto& l) { return l.has_value(); });
        bool map = bench.item().settings.value("map", false);  // made by the first case only
        const auto enter = [&](const BackendSpec& spec) {
            std::optional<Case> entered =
                bench.enter(spec, {"stability", {{"limits", listed}, {"map", map}}}, {.at_once = true});
            if (entered && empty) {
                bench.refuse(spec, "nothing oscillates, or how fast is not known");
                entered.reset();
            }
            if (entered) map = false;
            return entered;
        };
        measure_suites(bench, {.enter = enter});
    }
    void make_lists(Result& result) const override {
        result.rows<StabilityRow>("stability");
        result.rows<nlohmann::json>("stability_map");
    }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_stability(result, out, width);
        print_unmeasured(result, out);
    }
};

const RegisteredStudyKind stability_kind("stability", [] { return std::make_unique<StabilityKind>(); });

}  // namespace
}  // namespace voxspring
