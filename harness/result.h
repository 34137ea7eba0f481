// The result file: Google Benchmark's schema with our fields, written so that no reader ever sees half of
// it, and the table for people.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

/// Replaces `path` by `text` in one step: a reader sees the old file or the new one. Throws
/// std::system_error, leaving `path` as it was.
void write_atomically(const std::filesystem::path& path, const std::string& text);

/// Writes all of it to an open file; false, with errno set, if not all of it could be written.
bool write_all(int file, std::string_view text);
/// Makes what was created in, renamed to or removed from a file's folder outlast a loss of power, as far as
/// the file system can.
void sync_folder_of(const std::filesystem::path& file);

/// Throws BadInput unless `path` ends in `extension` and its folder takes a new file. `option` is what
/// the message calls it.
void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension);

/// `context.voxspring`: what was built (commit, whether the tree was clean, compilers, their flags) and
/// the processor it runs on. The study adds the GPU.
nlohmann::json build_context();

/// Three significant digits with an SI prefix: "1.25 ms", "487 G/s".
std::string si(double value, const std::string& unit);

/// "1.2e-05", or "-" for what is not a number.
std::string error_text(const nlohmann::json& value);

/// Columns as wide as they must be, the first `names` of them to the left and the others, figures, to the
/// right.
void print_aligned(const std::vector<std::vector<std::string>>& rows, std::ostream& out,
                   std::size_t names = 2);

/// Whether a row of `benchmarks` is the median of its repetitions. One repetition has no aggregates: its only
/// row is its median.
bool is_median(const nlohmann::json& row);

/// SCENE/BACKEND/FORMULATION/PRECISION[/TUNING] of a row's name, without what Google Benchmark adds.
std::string contender_name(const nlohmann::json& row);

/// "gl_fragment_implicit increment float32 mask=none" of a row's name.
std::string contender(const nlohmann::json& row);

/// What was skipped and what failed, each reason once with all that it holds for.
void print_unmeasured(const nlohmann::json& result, std::ostream& out);

/// One row a contender that passed, fastest first within a scene: time a step (median over the
/// repetitions), particle and spring updates a second, errors, time as a multiple of the fastest, and the
/// fraction of its limit that it reached. Then where float64 is chaotic, the limits of the devices, what was
/// skipped and what failed, with the reasons.
void print_table(const nlohmann::json& result, std::ostream& out);

}  // namespace voxspring
