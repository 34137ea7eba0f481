#include "harness/study/suite.h"

#include <set>
#include <utility>

#include "harness/base/interruption.h"

namespace voxspring {
namespace {

std::string key_of(std::size_t number) { return "measurement " + std::to_string(number); }

/// Measures what is missing.
void complete(StudyBench& bench, Case& benchmark_case, const nlohmann::json& known, const OnEvent& on_event) {
    JournalScope& scope = benchmark_case.scope();
    std::set<std::string> finished;
    while (const nlohmann::json* measurement = scope.find(key_of(finished.size() + 1)))
        finished.insert(measurement->at("measured").get<std::string>());
    std::size_t count = finished.size();
    const auto& specs = bench.specs();
    int place = 0;
    while (place < int(specs.size()) && specs[std::size_t(place)].label() != benchmark_case.spec().label())
        ++place;
    std::string at = "before its first measurement";
    const auto hear = [&](const nlohmann::json& event) {
        if (event.contains("begun")) {
            at = event.at("begun");
            bench.show(benchmark_case.spec().label() + " " + at, place, int(specs.size()));
        } else if (event.contains("measured")) {
            scope.keep(key_of(++count), event);
            if (interrupted()) throw Interrupted();
        } else if (on_event) {
            on_event(event);
        }
    };
    const auto failure = failure_of([&] {
        (void)benchmark_case.ask({{"do", "suite"}, {"finished", finished}, {"known", known}},
                                 "making that measurement", hear);
        scope.keep("finished", true);
    });
    if (failure) scope.keep("failed", at + ": " + *failure);
}

}  // namespace

nlohmann::json SuiteRunner::answer(Backend& backend, const nlohmann::json& question,
                                   const OnEvent& on_event) {
    const std::set<std::string> finished = question.at("finished");
    const auto once = [&](const std::string& name, const std::function<Rows()>& measure) {
        if (finished.contains(name)) return;
        on_event({{"begun", name}});
        const Rows rows = measure();
        on_event({{"measured", name}, {"rows", rows}});
    };
    run(backend, question.at("known"), once, on_event);
    return nullptr;
}

void measure_suite(StudyBench& bench, Case& benchmark_case, const nlohmann::json& known,
                   const OnEvent& on_event) {
    JournalScope& scope = benchmark_case.scope();
    if (scope.find("finished") == nullptr && scope.find("failed") == nullptr)
        complete(bench, benchmark_case, known, on_event);
    for (std::size_t i = 1; const nlohmann::json* measurement = scope.find(key_of(i)); ++i) {
        for (const auto& [list, measured] : measurement->at("rows").items()) {
            for (const nlohmann::json& row : measured) bench.add(list, row);
        }
    }
    bench.add_failure(benchmark_case);
}

}  // namespace voxspring
