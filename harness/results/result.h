// The result: Google Benchmark's schema with our fields, and the table for people.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "harness/results/row.h"
#include "harness/results/table.h"

namespace voxspring {

/// `context.voxspring`: the build (commit, whether the tree was clean, compilers, their flags) and the
/// processor that it runs on. The study adds the GPU.
nlohmann::json build_context();

/// The time of a step in each repetition, in us, by the name of the case.
using StepTimes = std::map<std::string, std::vector<double>>;
StepTimes step_times_of(const std::vector<Row>& rows);

/// "~1.25 us +-6%": the time of a step. It begins with the mark of a row that is not to be trusted, and ends
/// with relative_spread() of the repetitions if that is 3% or more.
std::string time_text(const Row& row, double seconds, const StepTimes& repetitions);

/// Prints one line per reason not to trust rows: how many rows, and which in a few words. The table marks
/// each such row, and the file has its figures.
void print_noise(const std::vector<Row>& rows, std::ostream& out);

/// Prints the cases that were faster than their limit, if any. In these the limit is wrong, not the time.
void print_above_limit(const std::vector<Row>& rows, std::ostream& out);

/// Prints what was skipped and what failed. A reason for skipping takes one line: how many backends, of what
/// kind, on how many scenes. A reason for failure names every case that it holds for.
void print_unmeasured(const nlohmann::json& result, std::ostream& out);

/// Names of backends in a few words: "cpu_parallel, cpu_reference", "10 cuda_* backends", "12 backends".
std::string names_in_short(const std::vector<std::string>& names);

/// Prints one row per case that passed, fastest first within a scene: time per step (median over the
/// repetitions), particle and spring updates per second, errors, time as a multiple of the fastest, and the
/// fraction of its limit that it reached. Then follow the scenes where float64 is chaotic, the limits of the
/// devices, and what was skipped or failed, with the reasons.
void print_table(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
