// Suites: measurements that a case makes one after the other in its process.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "harness/process/case_runner.h"
#include "harness/study/study_bench.h"

namespace voxspring {

/// Rows by the list of the result that they belong to.
using Rows = std::map<std::string, std::vector<nlohmann::json>>;

/// How a suite makes a measurement, whose name is its own within the suite: by calling `measure`, or not
/// where it is known by that name.
using Once = std::function<void(const std::string& name, const std::function<Rows()>& measure)>;

/// What a case does in its process to go through a suite.
class SuiteRunner : public CaseRunner {
public:
    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent& on_event) final;

private:
    /// `known` is what measure_suites() was given. Events are for whoever called that.
    virtual void run(Backend& backend, const nlohmann::json& known, const Once& once,
                     const OnEvent& on_event) = 0;
};

/// What the cases of a scene have in common.
struct Suites {
    /// A case of a backend, whose runner is a SuiteRunner; nothing where it cannot run, whose row is then
    /// there.
    std::function<std::optional<Case>(const BackendSpec&)> enter;
    /// What the cases so far have found out for the next one.
    std::function<nlohmann::json()> known = [] { return nlohmann::json(); };
    OnEvent on_event = {};
};

/// Takes every backend of the bench through its suite; what the journal has is not measured again. Rows go to
/// the bench, in the order of its backends. What fails a suite as a whole, the end of its process included,
/// is a row of `failed`. Once interrupted, the rows so far.
///
/// A suite is not timed. So StudyOptions::side_by_side of them are gone through at once, but for the first,
/// which finds out what the others are told, and for those of the processor, which take all of its cores.
void measure_suites(StudyBench& bench, const Suites& suites);

}  // namespace voxspring
