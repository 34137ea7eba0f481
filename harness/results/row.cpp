#include "harness/results/row.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "harness/results/row_fields.h"

namespace voxspring {
namespace {

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
void common_fields(Self& row, Fields& fields) {
    fields.list("noisy", row.noisy);
    fields.counters(row.counters);
    fields.optional("min_card_mhz", row.min_card_mhz);
    fields.optional("shared_process", row.shared_process);
    fields.optional("max_card_mhz", row.max_card_mhz);
    fields.optional("reason", row.reason);
    fields.optional("pattern", row.pattern);
}

/// Calls visit(part, key) for every part that may be absent. JSON has the part if it has this key.
void each_part(auto& row, const auto& visit) {
    visit(row.workpiece, "particles");
    visit(row.errors, "error_relative_l2");
    visit(row.benchmark, "run_type");
    visit(row.limit, "limit_seconds");
    visit(row.start, "ready_seconds");
    visit(row.choice, "chosen");
    visit(row.edits, "edits");
    visit(row.reference, "reference");
    visit(row.verdict, "passed");
}

void fields_of(auto& part, auto& of) {
    if constexpr (requires { part.relative_l2; }) {
        error_fields_of(part, of);
    } else {
        std::remove_cvref_t<decltype(part)>::fields(part, of);
    }
}

}  // namespace

bool BenchmarkPart::is_median() const {
    return aggregate_name ? *aggregate_name == "median" : run_type == "iteration" && repetitions == 1;
}

bool BenchmarkPart::is_time() const {
    return !aggregate_name || *aggregate_name == "mean" || *aggregate_name == "median";
}

std::optional<bool> VerdictPart::verified() const {
    if (!strained_share) return std::nullopt;
    return passed &&
           std::max(*strained_share, strained_start ? strained_start->share : 0) >= min_strained_share;
}

std::optional<double> VerdictPart::threshold() const {
    const auto of = [](std::optional<double> bound, std::optional<double> motion) -> std::optional<double> {
        if (!bound || !std::isfinite(*bound) || !(motion > 0.0)) return {};
        return *bound / *motion;
    };
    const auto first = [&](const auto& part) {
        const auto rms = of(part.tolerance_rms, part.motion_rms);
        return rms ? rms : of(part.tolerance, part.motion_max);
    };
    return strained_start ? first(*strained_start) : first(*this);
}

bool VerdictPart::moved() const {
    const auto any = [](const auto& part) { return part.motion_rms > 0.0 || part.motion_max > 0.0; };
    return strained_start ? any(*strained_start) : any(*this);
}

std::string Row::case_name() const { return identity.name.substr(0, identity.name.find("/iterations:")); }

std::string Row::label() const {
    std::string text = case_name().substr(identity.scene.size() + 1);
    std::replace(text.begin(), text.end(), '/', ' ');
    return text;
}

nlohmann::json to_json(const Row& row) {
    nlohmann::json json;
    RowWriter writer(json);
    Identity::fields(row.identity, writer);
    common_fields(row, writer);
    each_part(row, [&](const auto& part, const char*) {
        if (part) fields_of(*part, writer);
    });
    return json;
}

Row row_from_json(const nlohmann::json& json) {
    Row row;
    RowReader reader(json);
    Identity::fields(row.identity, reader);
    common_fields(row, reader);
    each_part(row, [&](auto& part, const char* key) {
        if (!json.contains(key)) return;
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
