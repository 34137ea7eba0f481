// Suites: series of measurements, each of which a case makes in its process.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "harness/process/case_runner.h"
#include "harness/study/study_bench.h"

namespace voxspring {

/// Rows, by the list of the result that they belong to.
using Rows = std::map<std::string, std::vector<nlohmann::json>>;

/// How a suite makes a measurement: calls `measure`, unless the journal already has the measurement `name`.
/// The name must be unique within the suite.
using Once = std::function<void(const std::string& name, const std::function<Rows()>& measure)>;

/// Runs a suite in a case's process.
class SuiteRunner : public CaseRunner {
public:
    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent& on_event) final;

private:
    /// `known` is what SuiteHooks::known returned in the study's process, and `on_event` sends events to
    /// SuiteHooks::on_event there.
    virtual void run(Backend& backend, const nlohmann::json& known, const Once& once,
                     const OnEvent& on_event) = 0;
};

/// What measure_suites() needs for the cases of a scene.
struct SuiteHooks {
    /// Makes the case of a backend; the runner of that case is a SuiteRunner. Returns empty if the case
    /// cannot run, and has then added a row that says so, or if the study is interrupted.
    std::function<std::optional<Case>(const BackendSpec&)> enter;
    /// Returns what earlier cases have found out, as information for the next one. May be an empty function.
    std::function<nlohmann::json()> known = {};
    OnEvent on_event = {};
};

/// Runs the suite for every backend of the bench. Measurements that the journal already has are not repeated.
/// Rows are added to the bench in the order of its backends. If a suite fails as a whole, for example because
/// its process ends, it has a row in `failed`. After an interruption the rows so far are kept.
///
/// A suite is not timed, so StudyOptions::side_by_side of them run at once. Two kinds of suites run alone:
/// the first one, whose findings the others need, and those of backends on the processor, which take all
/// cores.
void measure_suites(StudyBench& bench, const SuiteHooks& suites);

}  // namespace voxspring
