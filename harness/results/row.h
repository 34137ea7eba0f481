// A row of a result (results/schema.json) and its JSON. Every key appears once in row.cpp, for reading and
// writing.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/verification/errors.h"

namespace voxspring {

/// The scene and the backend of a row.
struct Identity {
    std::string name = {};  ///< SCENE/BACKEND/FORMULATION/PRECISION[/TUNING]
    std::string scene = {}, backend = {}, formulation = {}, precision = {}, tuning = {};
};

/// The work that was run.
struct Workpiece {
    int steps = 0;
    std::uint64_t particles = 0, springs = 0;
};

/// The fields of Google Benchmark's schema 1. Times are per step.
struct BenchmarkPart {
    std::string run_name;
    std::string run_type = "iteration";  ///< or "aggregate"
    int repetitions = 0;
    std::optional<int> repetition_index;        ///< of an iteration
    std::optional<std::string> aggregate_name;  ///< "mean", "median", "stddev", "cv"
    std::optional<std::string> aggregate_unit;
    int iterations = 0;
    double real_microseconds = 0, cpu_microseconds = 0;
    int family_index = 0, per_family_instance_index = 0, threads = 1;
    std::string time_unit = "us";
    double particle_updates_per_second = 0, spring_updates_per_second = 0;
    double host_seconds_per_step = 0;

    /// Whether this row is the median of its repetitions. A single repetition has no aggregates: its only row
    /// counts as the median.
    bool is_median() const;
    /// Whether this row is a time rather than a measure of how times spread.
    bool is_time() const;
};

/// The shortest possible time of a step on the row's device; empty if that is not known.
struct LimitPart {
    std::optional<double> seconds = {};
    std::optional<std::string> limited_by = {};
    std::optional<double> fraction = {};  ///< only of a row that is a time
    /// StepWork of a step; empty if steps leave out parts of the body.
    std::optional<std::uint64_t> bytes = {}, written_bytes = {}, footprint_bytes = {}, operations = {};
};

/// The time from the construction of a backend to its first step.
struct StartPart {
    double construct_seconds = 0, compile_seconds = 0, upload_seconds = 0;
    double ready_seconds = 0;                       ///< sum of the three, with no compiled kernel on disk
    std::optional<double> warm_ready_seconds = {};  ///< with all compiled kernels on disk; not in older files
};

/// What a backend chose for a scene and a device.
struct ChoicePart {
    std::string chosen;            ///< Choice::tuning
    double predicted_seconds = 0;  ///< Choice::step_seconds
};

/// The cost of edits between steps.
struct EditPart {
    int edits = 0;
    double median_seconds = 0, max_seconds = 0;
    double seconds_per_step_without = 0;
};

/// How the errors of a timing study were computed.
struct ReferencePart {
    std::uint64_t voxels = 0;
    int error_steps = 0;
    std::string reference;
};

/// Whether a state agrees with the reference.
struct VerdictPart {
    bool passed = false, finite = false;
    std::optional<double> error_rms = {}, tolerance = {}, tolerance_rms = {};
    /// Figures of the perturbed reference; empty if none was run.
    std::optional<double> spread_max = {}, spread_rms = {}, motion_max = {}, motion_rms = {};
    std::optional<WorkCount> work = {};
};

/// A row of any list. It has the parts that its list asks for.
struct Row {
    Identity identity;
    std::optional<Workpiece> workpiece = {};
    std::optional<Errors> errors = {};
    std::optional<BenchmarkPart> benchmark = {};
    std::optional<LimitPart> limit = {};
    std::optional<StartPart> start = {};
    std::optional<ChoicePart> choice = {};
    std::optional<EditPart> edits = {};
    std::optional<ReferencePart> reference = {};
    std::optional<VerdictPart> verdict = {};
    std::vector<std::string> noisy = {};  ///< why its time is not to be trusted
    /// Range of the card's clock, which is read after each repetition.
    std::optional<unsigned> min_card_mhz = {}, max_card_mhz = {};
    std::optional<bool> resumed = {};         ///< true, or absent
    std::optional<std::string> reason = {};   ///< why it was skipped, failed or chosen
    std::optional<std::string> pattern = {};  ///< of a choice: the pattern that asked for it

    /// Median time of a step. The row must have a benchmark.
    double step_seconds() const { return 1e-6 * benchmark.value().real_microseconds; }
    /// The backend and its options: "gl_fragment_implicit increment float32 mask=none".
    std::string label() const;
    /// SCENE/BACKEND/FORMULATION/PRECISION[/TUNING], without the suffix that Google Benchmark adds.
    std::string case_name() const;
    /// "~" to precede a figure that is not to be trusted, otherwise empty.
    std::string noise_mark() const { return noisy.empty() ? "" : "~"; }
    /// Whether the row took less time than its limit. If so, the limit is wrong.
    bool above_limit() const { return limit && limit->fraction && *limit->fraction > 1; }
    /// "!" to follow the fraction of a limit that is wrong, otherwise empty.
    std::string limit_mark() const { return above_limit() ? "!" : ""; }
};

nlohmann::json to_json(const Row& row);
/// A part whose first key is missing is absent. Other missing keys have their defaults.
Row row_from_json(const nlohmann::json& json);
std::vector<Row> rows_from_json(const nlohmann::json& list);

/// A row that has only its identity.
Row row_of(const std::string& scene, const BackendSpec& spec);

nlohmann::json to_json(const Errors& errors);

}  // namespace voxspring
