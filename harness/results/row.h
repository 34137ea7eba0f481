// A row of a result: what was measured in one case (results/schema.json). A row consists of parts. Each part
// lists its JSON keys once, in `fields`, for reading and for writing (row_fields.h); row.cpp lists those of
// Errors.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/results/counters.h"
#include "harness/verification/errors.h"

namespace voxspring {

/// The scene and the backend of a row.
struct Identity {
    /// SCENE/BACKEND/FORMULATION/PRECISION[/TUNING]. In `benchmarks` the suffix of Google Benchmark follows.
    std::string name = {};
    std::string scene = {}, backend = {}, formulation = {}, precision = {}, tuning = {};

    static void fields(auto& part, auto& of) {
        of.required("name", part.name);
        of.required("scene", part.scene);
        of.required("backend", part.backend);
        of.required("formulation", part.formulation);
        of.required("precision", part.precision);
        of.required("tuning", part.tuning);
    }
};

/// The number of steps that were run, and the size of the body.
struct Workpiece {
    int steps = 0;
    std::uint64_t particles = 0, springs = 0;

    static void fields(auto& part, auto& of) {
        of.required("steps", part.steps);
        of.required("particles", part.particles);
        of.required("springs", part.springs);
    }
};

/// The fields of Google Benchmark's schema 1. Times are per step.
struct BenchmarkPart {
    std::string run_name;
    std::string run_type = "iteration";  ///< or "aggregate"
    int repetitions = 0;
    std::optional<int> repetition_index;        ///< only in a row of an iteration
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

    static void fields(auto& part, auto& of) {
        of.required("run_type", part.run_type);
        of.required("run_name", part.run_name);
        of.required("repetitions", part.repetitions);
        of.optional("repetition_index", part.repetition_index);
        of.optional("aggregate_name", part.aggregate_name);
        of.optional("aggregate_unit", part.aggregate_unit);
        of.required("iterations", part.iterations);
        of.required("real_time", part.real_microseconds);
        of.required("cpu_time", part.cpu_microseconds);
        of.required("time_unit", part.time_unit);
        of.required("family_index", part.family_index);
        of.required("per_family_instance_index", part.per_family_instance_index);
        of.required("threads", part.threads);
        of.required("particle_updates_per_second", part.particle_updates_per_second);
        of.required("spring_updates_per_second", part.spring_updates_per_second);
        of.required("host_seconds_per_step", part.host_seconds_per_step);
    }
};

/// The shortest possible time of a step on the row's device; empty if that is not known.
struct LimitPart {
    std::optional<double> seconds = {};
    std::optional<std::string> limited_by = {};
    std::optional<double> fraction = {};  ///< `seconds` over the measured time; only if is_time()
    /// What a step moves and computes (see StepWork); empty if it is not known, or if steps leave out parts
    /// of the body.
    std::optional<std::uint64_t> bytes = {}, written_bytes = {}, footprint_bytes = {}, operations = {};

    static void fields(auto& part, auto& of) {
        of.nullable("limit_seconds", part.seconds);
        of.nullable("limited_by", part.limited_by);
        of.nullable("fraction_of_limit", part.fraction);
        of.nullable("step_bytes", part.bytes);
        of.nullable("step_written_bytes", part.written_bytes);
        of.nullable("step_footprint_bytes", part.footprint_bytes);
        of.nullable("step_operations", part.operations);
    }
};

/// The time from the construction of a backend to its first step.
struct StartPart {
    double construct_seconds = 0, compile_seconds = 0, upload_seconds = 0;
    double ready_seconds = 0;  ///< sum of the three above, if no compiled kernel is on disk
    /// Like `ready_seconds`, but with all compiled kernels on disk; not in older files.
    std::optional<double> warm_ready_seconds = {};

    static void fields(auto& part, auto& of) {
        of.required("ready_seconds", part.ready_seconds);
        of.optional("warm_ready_seconds", part.warm_ready_seconds);
        of.required("construct_seconds", part.construct_seconds);
        of.required("compile_seconds", part.compile_seconds);
        of.required("upload_seconds", part.upload_seconds);
    }
};

/// The tuning that a backend chose by itself for a scene and a device.
struct ChoicePart {
    std::string chosen;                                      ///< Choice::tuning
    std::optional<double> predicted_seconds = std::nullopt;  ///< Choice::step_seconds

    static void fields(auto& part, auto& of) {
        of.required("chosen", part.chosen);
        of.optional("predicted_seconds", part.predicted_seconds);
    }
};

/// The cost of edits between steps.
struct EditPart {
    int edits = 0;
    double median_seconds = 0, max_seconds = 0;
    double seconds_per_step_without = 0;

    static void fields(auto& part, auto& of) {
        of.required("edits", part.edits);
        of.required("edit_seconds_median", part.median_seconds);
        of.required("edit_seconds_max", part.max_seconds);
        of.required("seconds_per_step_without_edits", part.seconds_per_step_without);
    }
};

/// The reference run that the errors of a timing study were computed with.
struct ReferencePart {
    std::uint64_t voxels = 0;
    int error_steps = 0;
    std::string reference;

    static void fields(auto& part, auto& of) {
        of.required("reference", part.reference);
        of.required("voxels", part.voxels);
        of.required("error_steps", part.error_steps);
    }
};

/// The errors of a verification run that starts with every spring strained.
struct StrainedPart {
    /// The share of the springs whose length at the end differs from the rest length by more than the smaller
    /// of `tolerance` and `tolerance_rms` (strained_share()).
    double share = 0;
    std::optional<double> error_max = {}, error_rms = {}, error_mean = {};
    std::optional<double> tolerance = {}, tolerance_rms = {}, tolerance_mean = {};
    std::optional<double> motion_max = {}, motion_rms = {};

    static void fields(auto& part, auto& of) {
        of.required("strained_share", part.share);
        of.nullable("error_max", part.error_max);
        of.nullable("error_rms", part.error_rms);
        of.nullable("error_mean", part.error_mean);
        of.nullable("tolerance", part.tolerance);
        of.nullable("tolerance_rms", part.tolerance_rms);
        of.nullable("tolerance_mean", part.tolerance_mean);
        of.nullable("motion_max", part.motion_max);
        of.nullable("motion_rms", part.motion_rms);
    }
};

/// Whether a state agrees with the reference.
struct VerdictPart {
    bool passed = false, finite = false;
    std::optional<double> error_rms = {}, tolerance = {}, tolerance_rms = {};
    /// Figures of runs of the reference with rounding added (Spread); empty if there were no such runs.
    std::optional<double> spread_max = {}, spread_rms = {}, motion_max = {}, motion_rms = {};
    std::optional<WorkCount> work = {};
    // The members from here on are not in older files. In these only the last repetition was judged.
    std::optional<int> repetitions_judged = {};
    std::optional<double> error_mean = {}, tolerance_mean = {};
    /// StrainedPart::share of the run from the scene's own start.
    std::optional<double> strained_share = {};
    /// A second run, from a strained start; only if `strained_share` is below min_strained_share.
    std::optional<StrainedPart> strained_start = {};

    /// Whether the state passed in a run that strained enough springs that wrong springs would have made it
    /// fail. Empty: not known.
    std::optional<bool> verified() const;
    /// The largest accepted rms error as a fraction of the body's rms motion. If the rms error is not judged,
    /// the largest accepted error of a particle as a fraction of the largest motion. If there is a run from
    /// a strained start, these are figures of that run. Empty if no error is judged, or if the motion is not
    /// known or 0.
    std::optional<double> threshold() const;
    /// Whether the body moved in the run that threshold() is of. False if that is not known.
    bool moved() const;

    static void fields(auto& part, auto& of) {
        of.required("passed", part.passed);
        of.required("finite", part.finite);
        of.nullable("error_rms", part.error_rms);
        of.nullable("tolerance", part.tolerance);
        of.nullable("tolerance_rms", part.tolerance_rms);
        of.nullable("spread_max", part.spread_max);
        of.nullable("spread_rms", part.spread_rms);
        of.nullable("motion_max", part.motion_max);
        of.nullable("motion_rms", part.motion_rms);
        of.optional("work", part.work);
        of.optional("repetitions_judged", part.repetitions_judged);
        of.nullable("error_mean", part.error_mean);
        of.nullable("tolerance_mean", part.tolerance_mean);
        of.optional("strained_share", part.strained_share);
        of.optional_object("strained_start", part.strained_start);
    }
};

/// What tells the cases of a result apart: a study may step one scene by several numbers of steps.
struct CaseKey {
    std::string name;  ///< Row::case_name()
    int steps = 0;     ///< 0: the row does not say them
    auto operator<=>(const CaseKey&) const = default;
};

/// A row of any list of a result. Parts that the rows of its list do not have are absent.
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
    Counters counters = {};               ///< metrics without a member
    std::vector<std::string> noisy = {};  ///< reasons not to trust the time
    /// Range of the card's clock, which is read after each repetition.
    std::optional<unsigned> min_card_mhz = {}, max_card_mhz = {};
    /// Whether the process that measured the row served other cases too.
    std::optional<bool> shared_process = {};
    std::optional<std::string> reason = {};   ///< why the case was skipped, failed, diverged or was chosen
    std::optional<std::string> pattern = {};  ///< "auto..." as asked for; only in the list `auto`

    /// The time per step, in seconds. The row must have a benchmark.
    double step_seconds() const { return 1e-6 * benchmark.value().real_microseconds; }
    /// The backend and its options: "gl_fragment_implicit increment float32 mask=none".
    std::string label() const;
    /// SCENE/BACKEND/FORMULATION/PRECISION[/TUNING], without the suffix that Google Benchmark adds.
    std::string case_name() const;
    CaseKey case_key() const { return {case_name(), workpiece ? workpiece->steps : 0}; }
    /// "~", to be printed before a time that is not to be trusted, otherwise empty.
    std::string noise_mark() const { return noisy.empty() ? "" : "~"; }
    /// Whether the time of the row is shorter than its limit, which is then wrong.
    bool above_limit() const { return limit && limit->fraction && *limit->fraction > 1; }
    /// "!", to be printed after LimitPart::fraction if the limit is wrong, otherwise empty.
    std::string limit_mark() const { return above_limit() ? "!" : ""; }
};

nlohmann::json to_json(const Row& row);
/// Reads a row. A part is absent if the key that each_part() (row.cpp) names for it is missing. Any other
/// missing key leaves the default.
Row row_from_json(const nlohmann::json& json);
std::vector<Row> rows_from_json(const nlohmann::json& list);

/// A row that has only its identity.
Row row_of(const std::string& scene, const BackendSpec& spec);

}  // namespace voxspring
