#include "harness/choice/auto_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "auto_rule_files.h"  // generated
#include "backends/outpaced.h"
#include "harness/base/json.h"
#include "harness/results/capabilities.h"
#include "harness/results/result.h"

namespace voxspring {
namespace {

constexpr double any_number = std::numeric_limits<double>::infinity();

/// Backends that are never chosen for scenes with edits: they rebuild their tables at every edit, which takes
/// long for a large body.
const std::set<std::string> never_edited = {"cuda_march"};

/// Why a backend is fast, as text for users. A build that leaves the backend out does not know.
std::string reason_for(const std::string& backend) {
    const auto found = registry().find(backend);
    if (found == registry().end()) return "measured as the fastest";
    if (!found->second.strength.empty()) return found->second.strength;
    return found->second.addressing == Addressing::by_grid
               ? "a lattice needs no neighbour lists"
               : "neighbour lists allow springs beyond the lattice";
}

std::string count_text(std::uint64_t count) {
    if (count < 1000000) return std::to_string(count);
    return std::to_string(std::llround(double(count) * 1e-6)) + " million";
}

std::string said(const Rule& rule, const Workload& workload) {
    return rule.backend + (rule.tuning.empty() ? "" : ":" + rule.tuning) + ", " + describe(workload) + ": " +
           reason_for(rule.backend);
}

std::string options_of(const std::string& text) {
    const auto colon = text.find(':');
    return colon == std::string::npos ? "" : text.substr(colon + 1);
}

}  // namespace

const std::vector<Rule>& rules() {
    static const std::vector<Rule> list = [] {
        std::vector<Rule> all;
        const nlohmann::json file = parsed_json(auto_rule_files.at("auto_rules.json"));
        const auto bound = [](const nlohmann::json& value) {
            return value.is_null() ? any_number : value.get<double>();
        };
        const nlohmann::json& edited = file.at("edited").at("min_steps_between_edits");
        for (const nlohmann::json& block : file.at("rules")) {
            const auto& particles = block.at("particles");
            const auto& occupancy = block.at("occupancy");
            for (const std::string contender : block.at("order")) {
                const std::string backend = contender.substr(0, contender.find(':'));
                all.push_back({backend, options_of(contender), bound(particles[0]), bound(particles[1]),
                               bound(occupancy[0]), bound(occupancy[1]),
                               never_edited.contains(backend) ? any_number : edited.value(backend, 0.0),
                               block.at("increments")});
            }
        }
        return all;
    }();
    return list;
}

Workload workload_of(const Scene& scene, Formulation formulation) {
    double between = any_number;
    if (!scene.edits.empty()) between = (double(scene.edits.back().step) + 1) / double(scene.edits.size());
    return {scene.problem.lattice.voxel_count(), scene.problem.particle_count(), between,
            by_increments(formulation)};
}

bool holds(const Rule& rule, const Workload& workload) {
    const auto particles = double(workload.particles);
    // A network of springs without a lattice counts as having occupancy 0.
    const double occupancy = workload.voxels == 0 ? 0 : workload.occupancy();
    return particles >= rule.min_particles && particles < rule.max_particles &&
           occupancy >= rule.min_occupancy && occupancy < rule.max_occupancy &&
           workload.steps_between_edits >= rule.min_steps_between_edits &&
           workload.increments == rule.increments;
}

std::string describe(const Workload& workload) {
    if (workload.voxels == 0) return count_text(workload.particles) + " particles without a lattice";
    if (workload.voxels == workload.particles)
        return "a full lattice of " + count_text(workload.voxels) + " voxels";
    return count_text(workload.particles) + " particles in " +
           std::to_string(std::lround(100 * workload.occupancy())) + "% of " + count_text(workload.voxels) +
           " voxels";
}

bool asks_for_auto(const std::string& text) { return text == "auto" || text.starts_with("auto:"); }

Formulation check_auto(const std::string& text) {
    for (const std::string& item : listed_options(text)) {
        const std::string key = item.substr(0, item.find('='));
        if (key != "formulation" && key != "precision")
            throw BadSpecification("backend auto has no parameter '" + key +
                                   "'; known: precision, formulation");
    }
    // cpu_parallel has every formulation and precision, so parsing for it accepts all valid options.
    const std::string stand_in = "cpu_parallel", own = "auto";
    try {
        return BackendSpec::parse(stand_in + text.substr(own.size())).options.formulation;
    } catch (const BadSpecification& error) {
        std::string message = error.what();
        while (message.find(stand_in) != std::string::npos)
            message.replace(message.find(stand_in), stand_in.size(), own);
        throw BadSpecification(message);
    }
}

std::string passed_over_text(const BackendSpec& spec, const std::string& why) {
    return "; not " + spec.entry->name + ": " + why;
}

bool may_be_chosen(const Capabilities& capabilities) { return !capabilities.is_software; }

Chosen choose_by_rules(const std::string& text, const Scene& scene,
                       const std::function<bool(const BackendSpec&)>& takes) {
    const Workload workload = workload_of(scene, check_auto(text));
    const std::string options = options_of(text);
    for (const Rule& rule : rules()) {
        if (!holds(rule, workload) || registry().count(rule.backend) == 0) continue;
        const std::string both = options + (options.empty() || rule.tuning.empty() ? "" : ",") + rule.tuning;
        try {
            BackendSpec spec = BackendSpec::parse(rule.backend + (both.empty() ? "" : ":" + both));
            if (!takes(spec)) continue;
            return {std::move(spec), said(rule, workload)};
        } catch (const BadSpecification&) {
            // The backend does not have this formulation or precision: try the next rule.
        } catch (const Unavailable&) {
            // The backend's device is not on this machine: try the next rule.
        }
    }
    throw Unavailable("no backend of this build can run the scene on a device of this machine");
}

AutoChoice choose_backend(const std::string& text, const Scene& scene,
                          const std::function<bool(Backend&)>& accepts) {
    std::unique_ptr<Backend> backend;
    std::string passed_over;
    Chosen chosen = choose_by_rules(text, scene, [&](const BackendSpec& spec) {
        backend = spec.make();
        if (!may_be_chosen(backend->capabilities()) || !accepts(*backend)) return false;
        const std::string why = outpaced_by_another(*backend, scene.problem);
        if (!why.empty()) passed_over += passed_over_text(spec, why);
        return why.empty();
    });
    chosen.reason += passed_over;
    return {std::move(chosen), std::move(backend)};
}

nlohmann::json choose_among(const Result& result, const std::vector<Row>& rows) {
    const Row& first = rows.front();
    const Identity& of = first.identity;
    const double between = first.edits ? double(first.workpiece->steps) / first.edits->edits : any_number;
    const bool increments =
        std::any_of(every_formulation.begin(), every_formulation.end(),
                    [&](Formulation f) { return to_string(f) == of.formulation && by_increments(f); });
    const Workload workload{first.reference.value().voxels, first.workpiece.value().particles, between,
                            increments};
    // `known` are the backends with a row of this formulation and precision. `refused` are those of them that
    // did not run the scene.
    std::set<std::string> known, refused;
    for (const char* list : {"benchmarks", "skipped", "failed"}) {
        for (const Row& row : result.rows(list)) {
            if (row.identity.formulation != of.formulation || row.identity.precision != of.precision)
                continue;
            known.insert(row.identity.backend);
            if (row.reason && row.identity.scene == of.scene) refused.insert(row.identity.backend);
        }
    }
    const auto& backends = result.own_context().at("backends");
    nlohmann::json choice = {{"name", nullptr}, {"reason", "no rule holds"}, {"times_fastest", nullptr}};
    for (const Rule& rule : rules()) {
        if (!holds(rule, workload) || !known.contains(rule.backend) || refused.contains(rule.backend) ||
            !backends.contains(rule.backend) || !may_be_chosen(capabilities_of(backends.at(rule.backend))))
            continue;
        choice["reason"] = said(rule, workload);
        const std::string name = of.scene + "/" + rule.backend + "/" + of.formulation + "/" + of.precision +
                                 (rule.tuning.empty() ? "" : "/" + rule.tuning);
        double fastest = any_number, chosen = any_number;
        for (const Row& row : rows) {
            const double seconds = row.step_seconds();
            fastest = std::min(fastest, seconds);
            if (row.case_name() == name) chosen = std::min(chosen, seconds);
        }
        if (std::isfinite(chosen)) {
            choice["name"] = name;
            choice["times_fastest"] = chosen / fastest;
        }
        break;
    }
    return choice;
}

}  // namespace voxspring
