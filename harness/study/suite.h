// Suites: measurements that a case makes one after the other in its process.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
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
    /// `known` is what measure_suite() was given. Events are for whoever called that.
    virtual void run(Backend& backend, const nlohmann::json& known, const Once& once,
                     const OnEvent& on_event) = 0;
};

/// Takes a case, whose runner is a SuiteRunner, through its suite; what the journal has is not measured
/// again. Rows go to the bench. What fails the suite as a whole, the end of the process included, is a row of
/// `failed`. Once interrupted, the rows so far.
void measure_suite(StudyBench& bench, Case& benchmark_case, const nlohmann::json& known = {},
                   const OnEvent& on_event = {});

}  // namespace voxspring
