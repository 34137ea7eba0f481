#include "harness/study/suite.h"

#include <set>
#include <utility>

#include "harness/base/interruption.h"

namespace voxspring {
namespace {

class SuiteTask : public Task {
public:
    SuiteTask(BackendSpec spec, RunSuite run) : spec_(std::move(spec)), run_(std::move(run)) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const Post& post) override {
        const std::set<std::string> known = question.at("known");
        run_(
            spec_, backend,
            [&](const std::string& name, const std::function<Rows()>& measure) {
                if (known.contains(name)) return;
                post({{"begun", name}});
                const Rows rows = measure();
                post({{"measured", name}, {"rows", rows}});
            },
            post);
        return nullptr;
    }

private:
    BackendSpec spec_;
    RunSuite run_;
};

std::string key_of(std::size_t number) { return "measurement " + std::to_string(number); }

/// Measures what is missing.
void complete(Contender& contender, const std::function<void(const std::string& name)>& on_measurement,
              const Post& on_news) {
    Record& record = contender.record();
    std::set<std::string> known;
    while (const nlohmann::json* measurement = record.find(key_of(known.size() + 1)))
        known.insert(measurement->at("measured").get<std::string>());
    std::size_t count = known.size();
    std::string at = "before its first measurement";
    const auto hear = [&](const nlohmann::json& news) {
        if (news.contains("begun")) {
            at = news.at("begun");
            on_measurement(at);
        } else if (news.contains("measured")) {
            record.keep(key_of(++count), news);
            if (interrupted()) throw Interrupted();
        } else if (on_news) {
            on_news(news);
        }
    };
    const auto failure = failure_of([&] {
        (void)contender.ask({{"do", "suite"}, {"known", known}}, "making that measurement", hear);
        record.keep("finished", true);
    });
    if (failure) record.keep("failed", at + ": " + *failure);
}

}  // namespace

MakeTask suite_task(RunSuite run) {
    return [run = std::move(run)](const BackendSpec& spec) { return std::make_unique<SuiteTask>(spec, run); };
}

Rows measure_suite(Contender& contender, const std::string& scene,
                   const std::function<void(const std::string& name)>& on_measurement, const Post& on_news) {
    Record& record = contender.record();
    if (record.find("finished") == nullptr && record.find("failed") == nullptr)
        complete(contender, on_measurement, on_news);
    Rows rows;
    for (std::size_t i = 1; const nlohmann::json* measurement = record.find(key_of(i)); ++i) {
        for (const auto& [list, measured] : measurement->at("rows").items()) {
            for (const nlohmann::json& row : measured) rows[list].push_back(row);
        }
    }
    if (const nlohmann::json* reason = record.find("failed")) {
        rows["failed"].push_back(row_identity(scene, contender.spec()));
        rows["failed"].back()["reason"] = *reason;
    }
    return rows;
}

}  // namespace voxspring
