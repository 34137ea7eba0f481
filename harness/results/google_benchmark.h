// Google Benchmark's file format (schema 1), of measurements that are not its own: its compare.py and
// whatever else reads such files reads a result. Its library is asked what it knows of the processor.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "harness/results/row.h"

namespace voxspring {

/// Its `context`, but for the machine's name: results are published. `library_build_type` is that of this
/// program, whose code does the timing.
nlohmann::json google_benchmark_context();

/// One timed batch of steps.
struct Repetition {
    double device_seconds = 0, host_seconds = 0, cpu_seconds = 0;
};

/// The rows of one benchmark: one a repetition and, where there are several, their mean, median, stddev and
/// cv, each of every figure. `common` is what all of them have beside, its workpiece and limit included;
/// `family` numbers the benchmarks of one scene.
std::vector<Row> google_benchmark_rows(const Row& common, const std::vector<Repetition>& repetitions,
                                       int family);

}  // namespace voxspring
