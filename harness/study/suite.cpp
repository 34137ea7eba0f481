#include "harness/study/suite.h"

#include <deque>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "harness/base/interruption.h"
#include "harness/results/capabilities.h"

namespace voxspring {
namespace {

/// A case that runs its suite.
class SuiteCase {
public:
    SuiteCase(StudyBench& bench, Case benchmark_case, const OnEvent& on_event, const int& done)
        : bench_(bench), case_(std::move(benchmark_case)), on_event_(on_event), done_(done) {
        while (const nlohmann::json* measurement = measured(finished_.size() + 1))
            finished_.insert(measurement->at("measured").get<std::string>());
        kept_ = finished_.size();
    }

    /// Whether the suite runs on the processor's cores.
    bool is_on_processor() { return capabilities_of(case_.capabilities()).steps_on_host(); }

    /// Starts, in the case's process, the measurements that the journal lacks, and does not wait for them.
    /// `known` is what earlier cases have found out (SuiteHooks).
    void begin(const nlohmann::json& known) {
        if (scope().find("finished") != nullptr || scope().find("failed") != nullptr) return;
        attempt([&] {
            case_.begin({{"do", "suite"}, {"finished", finished_}, {"known", known}});
            working_ = true;
        });
    }

    /// Waits for the measurements and adds their rows.
    void finish() {
        if (working_ && !interrupted()) {
            attempt([&] {
                (void)case_.finish("making that measurement",
                                   [&](const nlohmann::json& event) { hear(event); });
                scope().keep("finished", true);
            });
        }
        for (std::size_t i = 1; const nlohmann::json* measurement = measured(i); ++i) {
            for (const auto& [list, rows] : measurement->at("rows").items()) {
                for (const nlohmann::json& row : rows) bench_.add(list, row);
            }
        }
        bench_.add_failure(case_);
        case_.dismiss();
    }

private:
    JournalScope& scope() { return case_.scope(); }
    static std::string key_of(std::size_t number) { return "measurement " + std::to_string(number); }
    const nlohmann::json* measured(std::size_t number) { return scope().find(key_of(number)); }

    void attempt(const std::function<void()>& action) {
        if (const auto failure = failure_of(action)) scope().keep("failed", at_ + ": " + *failure);
    }

    void hear(const nlohmann::json& event) {
        if (event.contains("begun")) {
            at_ = event.at("begun");
            bench_.show(case_.spec().label() + " " + at_, done_, bench_.expected_cases());
        } else if (event.contains("measured")) {
            scope().keep(key_of(++kept_), event);
            if (interrupted()) throw Interrupted();
        } else if (on_event_) {
            on_event_(event);
        }
    }

    StudyBench& bench_;
    Case case_;
    const OnEvent& on_event_;
    const int& done_;                 ///< number of cases finished so far
    std::set<std::string> finished_;  ///< names of the measurements that the journal already had
    std::size_t kept_ = 0;            ///< number of measurements in the journal
    std::string at_ = "before its first measurement";
    bool working_ = false;
};

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

void measure_suites(StudyBench& bench, const SuiteHooks& suites) {
    std::deque<std::unique_ptr<SuiteCase>> working;
    int done = 0;
    const auto finish_until = [&](std::size_t left) {
        for (; working.size() > left; working.pop_front()) {
            working.front()->finish();
            ++done;
        }
    };
    bool first = true;
    for (const BackendSpec& spec : bench.specs()) {
        std::optional<Case> entered = suites.enter(spec);
        if (!entered) continue;
        auto next = std::make_unique<SuiteCase>(bench, *std::move(entered), suites.on_event, done);
        const bool alone = std::exchange(first, false) || next->is_on_processor();
        finish_until(alone ? 0 : bench.side_by_side() - 1);
        next->begin(suites.known ? suites.known() : nlohmann::json());
        working.push_back(std::move(next));
        if (alone) finish_until(0);
    }
    finish_until(0);
}

}  // namespace voxspring
