#include "harness/study/suite.h"

#include <set>
#include <utility>

#include "harness/base/interruption.h"

namespace voxspring {
namespace {

class SuiteRunner : public CaseRunner {
public:
    SuiteRunner(BackendSpec spec, RunSuite run) : spec_(std::move(spec)), run_(std::move(run)) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question,
                          const OnEvent& on_event) override {
        const std::set<std::string> known = question.at("known");
        run_(
            spec_, backend,
            [&](const std::string& name, const std::function<Rows()>& measure) {
                if (known.contains(name)) return;
                on_event({{"begun", name}});
                const Rows rows = measure();
                on_event({{"measured", name}, {"rows", rows}});
            },
            on_event);
        return nullptr;
    }

private:
    BackendSpec spec_;
    RunSuite run_;
};

std::string key_of(std::size_t number) { return "measurement " + std::to_string(number); }

/// Measures what is missing.
void complete(Case& benchmark_case, const std::function<void(const std::string& name)>& on_measurement,
              const OnEvent& on_event) {
    JournalScope& scope = benchmark_case.scope();
    std::set<std::string> known;
    while (const nlohmann::json* measurement = scope.find(key_of(known.size() + 1)))
        known.insert(measurement->at("measured").get<std::string>());
    std::size_t count = known.size();
    std::string at = "before its first measurement";
    const auto hear = [&](const nlohmann::json& event) {
        if (event.contains("begun")) {
            at = event.at("begun");
            on_measurement(at);
        } else if (event.contains("measured")) {
            scope.keep(key_of(++count), event);
            if (interrupted()) throw Interrupted();
        } else if (on_event) {
            on_event(event);
        }
    };
    const auto failure = failure_of([&] {
        (void)benchmark_case.ask({{"do", "suite"}, {"known", known}}, "making that measurement", hear);
        scope.keep("finished", true);
    });
    if (failure) scope.keep("failed", at + ": " + *failure);
}

}  // namespace

MakeCaseRunner suite_runner(RunSuite run) {
    return
        [run = std::move(run)](const BackendSpec& spec) { return std::make_unique<SuiteRunner>(spec, run); };
}

Rows measure_suite(Case& benchmark_case, const std::string& scene,
                   const std::function<void(const std::string& name)>& on_measurement,
                   const OnEvent& on_event) {
    JournalScope& scope = benchmark_case.scope();
    if (scope.find("finished") == nullptr && scope.find("failed") == nullptr)
        complete(benchmark_case, on_measurement, on_event);
    Rows rows;
    for (std::size_t i = 1; const nlohmann::json* measurement = scope.find(key_of(i)); ++i) {
        for (const auto& [list, measured] : measurement->at("rows").items()) {
            for (const nlohmann::json& row : measured) rows[list].push_back(row);
        }
    }
    if (const nlohmann::json* reason = scope.find("failed")) {
        rows["failed"].push_back(row_identity(scene, benchmark_case.spec()));
        rows["failed"].back()["reason"] = *reason;
    }
    return rows;
}

}  // namespace voxspring
