// Google Benchmark's file format (schema 1) for measurements that its library did not make, so that
// compare.py and other readers of such files read our results. The library describes the processor.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "harness/results/row.h"

namespace voxspring {

/// Google Benchmark's `context` without the machine's name, since results are published. `library_build_type`
/// is the build type of this program, whose code does the timing.
nlohmann::json google_benchmark_context();

/// One timed batch of steps.
struct Repetition {
    double device_seconds = 0, host_seconds = 0, cpu_seconds = 0;
};

/// The rows of one benchmark: one per repetition and, if there are several, their mean, median, stddev and cv
/// for every figure. `common` has the fields that all rows share, workpiece and limit included. `family` is
/// the number of the benchmark within its scene.
std::vector<Row> google_benchmark_rows(const Row& common, const std::vector<Repetition>& repetitions,
                                       int family);

}  // namespace voxspring
