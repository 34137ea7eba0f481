// Writes measurements in Google Benchmark's file format (schema 1), so that its compare.py and other tools
// can read our results. Google Benchmark's library only describes the processor. It measures nothing here.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "harness/results/row.h"

namespace voxspring {

/// The object `context` of Google Benchmark's format, without the machine's name, since results are
/// published. `library_build_type` is the build type of this program, since this program does the timing.
nlohmann::json google_benchmark_context();

/// One timed batch of steps.
struct Repetition {
    double device_seconds = 0, host_seconds = 0, cpu_seconds = 0;
};

/// The rows of one benchmark: one per repetition and, if there are several repetitions, one each for the
/// mean, median, stddev and cv of every figure. `common` has the fields that all rows share, including
/// `workpiece` and `limit`. `family` becomes BenchmarkPart::family_index.
std::vector<Row> google_benchmark_rows(const Row& common, const std::vector<Repetition>& repetitions,
                                       int family);

}  // namespace voxspring
