// The result: Google Benchmark's schema with our fields, and the table for people.
#pragma once

#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

namespace voxspring {

/// `context.voxspring`: what was built (commit, whether the tree was clean, compilers, their flags) and
/// the processor it runs on. The study adds the GPU.
nlohmann::json build_context();

/// Whether a row of `benchmarks` is the median of its repetitions. One repetition has no aggregates: its only
/// row is its median.
bool is_median(const nlohmann::json& row);

/// SCENE/BACKEND/FORMULATION/PRECISION[/TUNING] of a row's name, without what Google Benchmark adds.
std::string case_name(const nlohmann::json& row);

/// "gl_fragment_implicit increment float32 mask=none" of a row's name.
std::string case_label(const nlohmann::json& row);

/// "~" before a figure of a row that is not to be trusted, else nothing.
std::string noise_mark(const nlohmann::json& row);
/// A line a reason with the cases that it holds for, of rows with a list `noisy`.
void print_noise(const std::vector<nlohmann::json>& rows, std::ostream& out);

/// What was skipped and what failed, each reason once with all that it holds for.
void print_unmeasured(const nlohmann::json& result, std::ostream& out);

/// One row a case that passed, fastest first within a scene: time a step (median over the
/// repetitions), particle and spring updates a second, errors, time as a multiple of the fastest, and the
/// fraction of its limit that it reached. Then where float64 is chaotic, the limits of the devices, what was
/// skipped and what failed, with the reasons.
void print_table(const nlohmann::json& result, std::ostream& out);

}  // namespace voxspring
