#include "harness/results/row.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "harness/results/row_fields.h"

namespace voxspring {
namespace {

// There is one function per part. It lists the part's keys, for reading and for writing.

template <class Self, class Fields>
void identity_fields(Self& part, Fields& fields) {
    fields.required("name", part.name);
    fields.required("scene", part.scene);
    fields.required("backend", part.backend);
    fields.required("formulation", part.formulation);
    fields.required("precision", part.precision);
    fields.required("tuning", part.tuning);
}

template <class Self, class Fields>
void workpiece_fields(Self& part, Fields& fields) {
    fields.required("steps", part.steps);
    fields.required("particles", part.particles);
    fields.required("springs", part.springs);
}

template <class Self, class Fields>
void error_fields_of(Self& part, Fields& fields) {
    fields.nullable("error_relative_l2", part.relative_l2);
    fields.nullable("error_max", part.max);
    fields.nullable("worst_particle", part.worst_particle);
    fields.nullable("total_error_relative_l2", part.total_relative_l2);
    fields.nullable("total_error_max", part.total_max);
    fields.nullable("total_error_uncertainty", part.total_uncertainty);
    fields.nullable("total_error_reason", part.total_reason);
    fields.nullable("momentum_error", part.momentum);
    fields.nullable("energy_error", part.energy);
    fields.required("chaotic", part.chaotic);
    fields.nullable("spread", part.spread);
}

template <class Self, class Fields>
void benchmark_fields(Self& part, Fields& fields) {
    fields.required("run_type", part.run_type);
    fields.required("run_name", part.run_name);
    fields.required("repetitions", part.repetitions);
    fields.optional("repetition_index", part.repetition_index);
    fields.optional("aggregate_name", part.aggregate_name);
    fields.optional("aggregate_unit", part.aggregate_unit);
    fields.required("iterations", part.iterations);
    fields.required("real_time", part.real_microseconds);
    fields.required("cpu_time", part.cpu_microseconds);
    fields.required("time_unit", part.time_unit);
    fields.required("family_index", part.family_index);
    fields.required("per_family_instance_index", part.per_family_instance_index);
    fields.required("threads", part.threads);
    fields.required("particle_updates_per_second", part.particle_updates_per_second);
    fields.required("spring_updates_per_second", part.spring_updates_per_second);
    fields.required("host_seconds_per_step", part.host_seconds_per_step);
}

template <class Self, class Fields>
void limit_fields_of(Self& part, Fields& fields) {
    fields.nullable("limit_seconds", part.seconds);
    fields.nullable("limited_by", part.limited_by);
    fields.nullable("fraction_of_limit", part.fraction);
    fields.nullable("step_bytes", part.bytes);
    fields.nullable("step_written_bytes", part.written_bytes);
    fields.nullable("step_footprint_bytes", part.footprint_bytes);
    fields.nullable("step_operations", part.operations);
}

template <class Self, class Fields>
void start_fields(Self& part, Fields& fields) {
    fields.required("ready_seconds", part.ready_seconds);
    fields.optional("warm_ready_seconds", part.warm_ready_seconds);
    fields.required("construct_seconds", part.construct_seconds);
    fields.required("compile_seconds", part.compile_seconds);
    fields.required("upload_seconds", part.upload_seconds);
}

template <class Self, class Fields>
void choice_fields(Self& part, Fields& fields) {
    fields.required("chosen", part.chosen);
    fields.required("predicted_seconds", part.predicted_seconds);
}

template <class Self, class Fields>
void edit_fields(Self& part, Fields& fields) {
    fields.required("edits", part.edits);
    fields.required("edit_seconds_median", part.median_seconds);
    fields.required("edit_seconds_max", part.max_seconds);
    fields.required("seconds_per_step_without_edits", part.seconds_per_step_without);
}

template <class Self, class Fields>
void reference_fields(Self& part, Fields& fields) {
    fields.required("reference", part.reference);
    fields.required("voxels", part.voxels);
    fields.required("error_steps", part.error_steps);
}

template <class Self, class Fields>
void verdict_fields(Self& part, Fields& fields) {
    fields.required("passed", part.passed);
    fields.required("finite", part.finite);
    fields.nullable("error_rms", part.error_rms);
    fields.nullable("tolerance", part.tolerance);
    fields.nullable("tolerance_rms", part.tolerance_rms);
    fields.nullable("spread_max", part.spread_max);
    fields.nullable("spread_rms", part.spread_rms);
    fields.nullable("motion_max", part.motion_max);
    fields.nullable("motion_rms", part.motion_rms);
    fields.optional("work", part.work);
}

template <class Self, class Fields>
void common_fields(Self& row, Fields& fields) {
    fields.list("noisy", row.noisy);
    fields.optional("min_card_mhz", row.min_card_mhz);
    fields.optional("max_card_mhz", row.max_card_mhz);
    fields.optional("resumed", row.resumed);
    fields.optional("reason", row.reason);
    fields.optional("pattern", row.pattern);
}

/// Calls `visit(part, fields function, first key)` for every part that may be absent.
template <class Self, class Visit>
void each_part(Self& row, const Visit& visit) {
    visit(
        row.workpiece, [](auto& part, auto& fields) { workpiece_fields(part, fields); }, "particles");
    visit(
        row.errors, [](auto& part, auto& fields) { error_fields_of(part, fields); }, "error_relative_l2");
    visit(
        row.benchmark, [](auto& part, auto& fields) { benchmark_fields(part, fields); }, "run_type");
    visit(
        row.limit, [](auto& part, auto& fields) { limit_fields_of(part, fields); }, "limit_seconds");
    visit(
        row.start, [](auto& part, auto& fields) { start_fields(part, fields); }, "ready_seconds");
    visit(
        row.choice, [](auto& part, auto& fields) { choice_fields(part, fields); }, "chosen");
    visit(
        row.edits, [](auto& part, auto& fields) { edit_fields(part, fields); }, "edits");
    visit(
        row.reference, [](auto& part, auto& fields) { reference_fields(part, fields); }, "reference");
    visit(
        row.verdict, [](auto& part, auto& fields) { verdict_fields(part, fields); }, "passed");
}

}  // namespace

bool BenchmarkPart::is_median() const {
    return aggregate_name ? *aggregate_name == "median" : run_type == "iteration" && repetitions == 1;
}

bool BenchmarkPart::is_time() const {
    return !aggregate_name || *aggregate_name == "mean" || *aggregate_name == "median";
}

std::string Row::case_name() const { return identity.name.substr(0, identity.name.find("/iterations:")); }

std::string Row::label() const {
    std::string text = case_name().substr(identity.scene.size() + 1);
    std::replace(text.begin(), text.end(), '/', ' ');
    return text;
}

nlohmann::json to_json(const Errors& errors) {
    nlohmann::json json;
    RowWriter writer(json);
    error_fields_of(errors, writer);
    return json;
}

nlohmann::json to_json(const Row& row) {
    nlohmann::json json;
    RowWriter writer(json);
    identity_fields(row.identity, writer);
    common_fields(row, writer);
    each_part(row, [&](const auto& part, const auto& fields_of, const char*) {
        if (part) fields_of(*part, writer);
    });
    return json;
}

Row row_from_json(const nlohmann::json& json) {
    Row row;
    RowReader reader(json);
    identity_fields(row.identity, reader);
    common_fields(row, reader);
    each_part(row, [&](auto& part, const auto& fields_of, const char* first) {
        if (!json.contains(first)) return;
        part.emplace();
        fields_of(*part, reader);
    });
    return row;
}

std::vector<Row> rows_from_json(const nlohmann::json& list) {
    std::vector<Row> rows;
    for (const auto& json : list) rows.push_back(row_from_json(json));
    return rows;
}

Row row_of(const std::string& scene, const BackendSpec& spec) {
    return {.identity = {.name = scene + "/" + spec.label(),
                         .scene = scene,
                         .backend = spec.entry->name,
                         .formulation = to_string(spec.options.formulation),
                         .precision = to_string(spec.options.precision),
                         .tuning = spec.tuning()}};
}

}  // namespace voxspring
