// The result: Google Benchmark's schema with our fields, and the table for people.
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "harness/results/row.h"
#include "harness/results/table.h"

namespace voxspring {

/// `context.voxspring`: what was built (commit, whether the tree was clean, compilers, their flags) and
/// the processor it runs on. The study adds the GPU.
nlohmann::json build_context();

/// By the name of a case, what a step took in each of its repetitions, in us.
using StepTimes = std::map<std::string, std::vector<double>>;
StepTimes step_times_of(const std::vector<Row>& rows);

/// "~1.25 us +-6%": the time of a step, with the mark of a row that is not to be trusted, and
/// relative_spread() of its repetitions from 3% on.
std::string time_text(const Row& row, double seconds, const StepTimes& repetitions);

/// A line per reason for which rows are not to be trusted: how many, and which in a few words. Each of them
/// has a mark in the table, and the file its figures.
void print_noise(const std::vector<Row>& rows, std::ostream& out);

/// The cases that were faster than their limit, if any: the limit is wrong, not the time.
void print_above_limit(const std::vector<Row>& rows, std::ostream& out);

/// What was skipped and what failed. A reason for which backends were skipped takes a line: how many, of what
/// kind, on how many scenes. One for which they failed names all that it holds for.
void print_unmeasured(const nlohmann::json& result, std::ostream& out);

/// "cpu_parallel, cpu_reference", "10 cuda_* backends", "12 backends": names of backends in a few words.
std::string names_in_short(const std::vector<std::string>& names);

/// One row a case that passed, fastest first within a scene: time a step (median over the
/// repetitions), particle and spring updates a second, errors, time as a multiple of the fastest, and the
/// fraction of its limit that it reached. Then where float64 is chaotic, the limits of the devices, what was
/// skipped and what failed, with the reasons.
void print_table(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
