// A row of a result (results/schema.json) and its JSON. Every key stands in row.cpp once, for both
// directions.
#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "backends/registry.h"
#include "harness/verification/errors.h"

namespace voxspring {

/// Which scene and backend a row is about.
struct Identity {
    std::string name = {};  ///< SCENE/BACKEND/FORMULATION/PRECISION[/TUNING]
    std::string scene = {}, backend = {}, formulation = {}, precision = {}, tuning = {};
};

/// What was run.
struct Workpiece {
    int steps = 0;
    std::uint64_t particles = 0, springs = 0;
};

/// What Google Benchmark's schema 1 says of a row; times are of one step.
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

    /// Whether it is the median of its repetitions. One repetition has no aggregates: its only row is its
    /// median.
    bool is_median() const;
    /// Whether it is a time rather than a measure of how times spread.
    bool is_time() const;
};

/// The shortest time of a step on its device; nothing where that is not known.
struct LimitPart {
    std::optional<double> seconds = {};
    std::optional<std::string> limited_by = {};
    std::optional<double> fraction = {};  ///< of a row that is a time
    /// StepWork's of a step; nothing where it takes less than the whole body.
    std::optional<std::uint64_t> bytes = {}, written_bytes = {}, footprint_bytes = {}, operations = {};
};

/// From nothing to the first step.
struct StartPart {
    double construct_seconds = 0, compile_seconds = 0, upload_seconds = 0;
    double ready_seconds = 0;                       ///< all three: with no kernel on disk
    std::optional<double> warm_ready_seconds = {};  ///< with all of them there; not in older files
};

/// What a backend chose for the scene and the device.
struct ChoicePart {
    std::string chosen;            ///< Choice::tuning
    double predicted_seconds = 0;  ///< Choice::step_seconds
};

/// What edits between steps cost.
struct EditPart {
    int edits = 0;
    double median_seconds = 0, max_seconds = 0;
    double seconds_per_step_without = 0;
};

/// How errors of a timing study were taken.
struct ReferencePart {
    std::uint64_t voxels = 0;
    int error_steps = 0;
    std::string reference;
};

/// Whether a state agrees with the reference.
struct VerdictPart {
    bool passed = false, finite = false;
    std::optional<double> error_rms = {}, tolerance = {}, tolerance_rms = {};
    /// Of the perturbed reference; nothing where none was run.
    std::optional<double> spread_max = {}, spread_rms = {}, motion_max = {}, motion_rms = {};
    std::optional<WorkCount> work = {};
};

/// A row has the parts that the list it stands in asks for.
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
    /// The card's clock, asked after each repetition.
    std::optional<unsigned> min_card_mhz = {}, max_card_mhz = {};
    std::optional<bool> resumed = {};         ///< true, or absent
    std::optional<std::string> reason = {};   ///< why it was skipped, failed or chosen
    std::optional<std::string> pattern = {};  ///< of a choice: what asked for it

    /// Median time of a step. Of a row with a benchmark.
    double step_seconds() const { return 1e-6 * benchmark.value().real_microseconds; }
    /// "gl_fragment_implicit increment float32 mask=none".
    std::string label() const;
    /// SCENE/BACKEND/FORMULATION/PRECISION[/TUNING], without what Google Benchmark adds.
    std::string case_name() const;
    /// "~" before a figure that is not to be trusted, else nothing.
    std::string noise_mark() const { return noisy.empty() ? "" : "~"; }
    /// Whether it took less time than its limit, which then is wrong.
    bool above_limit() const { return limit && limit->fraction && *limit->fraction > 1; }
    /// "!" after such a fraction, else nothing.
    std::string limit_mark() const { return above_limit() ? "!" : ""; }
};

nlohmann::json to_json(const Row& row);
/// Parts whose first key is missing are absent; other missing keys are at their defaults.
Row row_from_json(const nlohmann::json& json);
std::vector<Row> rows_from_json(const nlohmann::json& list);

/// A row of nothing but its identity.
Row row_of(const std::string& scene, const BackendSpec& spec);

nlohmann::json to_json(const Errors& errors);

/// Writes the fields that a function visits. With RowReader a kind of study names the keys of its own rows in
/// one function, which is called with either.
class RowWriter {
public:
    explicit RowWriter(nlohmann::json& json) : json_(json) {}

    static constexpr bool reads = false;
    template <class T>
    void required(const char* key, const T& value) {
        json_[key] = value;
    }
    /// null where there is none, or no finite number.
    template <class T>
    void nullable(const char* key, const std::optional<T>& value) {
        json_[key] = nullptr;
        if constexpr (std::is_floating_point_v<T>) {
            if (value && !std::isfinite(*value)) return;
        }
        if (value) json_[key] = *value;
    }
    /// Absent where there is none.
    template <class T>
    void optional(const char* key, const std::optional<T>& value) {
        if (value) json_[key] = *value;
    }
    /// Absent where it is empty.
    void list(const char* key, const std::vector<std::string>& values) {
        if (!values.empty()) json_[key] = values;
    }

private:
    nlohmann::json& json_;
};

/// Reads them. What is missing or null leaves the value as it is.
class RowReader {
public:
    explicit RowReader(const nlohmann::json& json) : json_(json) {}

    static constexpr bool reads = true;
    template <class T>
    void required(const char* key, T& value) {
        if (has(key)) value = json_.at(key).get<T>();
    }
    template <class T>
    void nullable(const char* key, std::optional<T>& value) {
        if (has(key)) value = json_.at(key).get<T>();
    }
    template <class T>
    void optional(const char* key, std::optional<T>& value) {
        nullable(key, value);
    }
    void list(const char* key, std::vector<std::string>& values) { required(key, values); }

private:
    bool has(const char* key) const { return json_.contains(key) && !json_.at(key).is_null(); }
    const nlohmann::json& json_;
};

}  // namespace voxspring
