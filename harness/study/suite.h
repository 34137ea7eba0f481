// Suites: measurements that a case makes one after the other in its process.
#pragma once

#include <functional>
#include <string>

#include "harness/study/measure.h"

namespace voxspring {

/// How a suite makes a measurement, whose name is its own within the suite: by calling `measure`, or not
/// where it is known by that name.
using Once = std::function<void(const std::string& name, const std::function<Rows()>& measure)>;

/// A suite. What it posts is for whoever calls measure_suite().
using RunSuite =
    std::function<void(const BackendSpec& spec, Backend& backend, const Once& once, const OnEvent& on_event)>;

/// What a case does in its process to go through a suite.
MakeCaseRunner suite_runner(RunSuite run);

/// Takes a case, whose runner is suite_runner(), through its suite; what the journal has is not measured
/// again. What fails the suite as a whole, the end of the process included, is a row of the list `failed`.
/// Once interrupted, the rows so far.
Rows measure_suite(Case& benchmark_case, const std::string& scene,
                   const std::function<void(const std::string& name)>& on_measurement,
                   const OnEvent& on_event = {});

}  // namespace voxspring
