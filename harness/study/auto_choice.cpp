#include "harness/study/auto_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>
#include <utility>

#include "harness/results/capabilities.h"
#include "harness/results/row.h"

namespace voxspring {
namespace {

constexpr double any_number = std::numeric_limits<double>::infinity();
constexpr double any_occupancy = 2;

bool is_software(const nlohmann::json& backend) { return capabilities_of(backend).is_software; }

std::string count_text(std::uint64_t count) {
    if (count < 1000000) return std::to_string(count);
    return std::to_string(std::llround(double(count) * 1e-6)) + " million";
}

std::string said(const Rule& rule, const Workload& workload) {
    return rule.backend + (rule.tuning.empty() ? "" : ":" + rule.tuning) + ", " + describe(workload) + ": " +
           rule.reason;
}

/// "auto:a=b,c=d" with keys that leave the choice open.
void check_options(const std::string& text) {
    const auto colon = text.find(':');
    if (colon == std::string::npos) return;
    std::istringstream rest(text.substr(colon + 1));
    for (std::string item; std::getline(rest, item, ',');) {
        const std::string key = item.substr(0, item.find('='));
        if (key != "formulation" && key != "precision")
            throw BadSpecification("backend auto has no parameter '" + key +
                                   "'; known: precision, formulation");
    }
}

std::string options_of(const std::string& text) {
    const auto colon = text.find(':');
    return colon == std::string::npos ? "" : text.substr(colon + 1);
}

}  // namespace

// Which figures a rule rests on stands beside it: results/nvidia-h200 and results/amd-epyc, microseconds a
// step. fastest_test holds the rules against every results/*/fastest.json: what they take is within 10% of
// the fastest. After a new measurement change the bounds here until it does. Beside a rule without a figure:
// no committed result has its backend yet.
const std::vector<Rule>& rules() {
    // Bounds that more than one rule shares.
    constexpr double max_resident = 6e4;   // 512 a multiprocessor of a large card
    constexpr double sparse = 0.5;         // occupancy under which lists are shorter than a lattice
    constexpr double min_marched = 1e6;    // particles from which on columns fill a card
    constexpr double fits_one_wave = 2e4;  // particles under which a step is a launch and little else
    static const std::vector<Rule> list = {
        // fastest.json: the box of 32^3 0.89 against 2.05 of cuda_implicit_cached:fetch=l1, the heart 1.29
        // against 2.59 of cuda_explicit_delta. edits.json: an edit laid its tables out anew, 9 ms; one in
        // place is not measured yet.
        // Where a tool moves it takes few steps a launch: not measured yet.
        {"cuda_resident", "", 0, max_resident, 0, any_occupancy, false,
         "state stays on the chip from step to step"},
        // fastest.json: the box of 48^3 2.02 against 4.33 of cuda_explicit_device:fetch=l1, 96^3 11.7 against
        // 16.7 of cuda_explicit_delta. An edit writes the masks of the threads that it touches.
        {"cuda_bricks", "", 0, min_marched, 0, any_occupancy, true,
         "what multiprocessors hold together stays there from step to step"},
        // figure8.json: the box of 128^3 27.0 against 40.5 of gl_compute_implicit, 256^3 171 against 301 of
        // cuda_implicit_cached:fetch=l1, 96^3 17.1 against 16.9 of cuda_explicit_delta. edits.json: an edit
        // lays its plan out anew, 0.17 ms on the box of 32^3.
        {"cuda_march", "", min_marched, any_number, sparse, any_occupancy, false,
         "each thread marches along a column and reads a particle once"},
        {"cuda_explicit_delta", "", 0, any_number, 0, sparse, true,
         "compressed lists of active particles alone"},
        // figure8.json: the box of 64^3 6.8 against 7.1 of cuda_implicit_cached:fetch=l1, 96^3 16.9 against
        // 18.4, 48^3 4.4 against 4.3 of cuda_explicit_cached_grid:fetch=l1.
        {"cuda_explicit_delta", "", max_resident, min_marched, sparse, any_occupancy, true,
         "between what the chip holds and what columns fill, compressed lists share a run's neighbours"},
        // table1.json: the heart 2.69 against 3.39 of cuda_implicit_cached, the box of 32^3 2.61
        // against 2.46.
        {"cuda_explicit_cached_grid", "", fits_one_wave, 1e5, 0, sparse, true,
         "lists of active particles alone"},
        // figure8.json: the box of 8^3 1.74 against 1.79 of cuda_implicit_cached:fetch=l1, 16^3 2.03 against
        // 1.86, 32^3 2.52 against 2.05.
        {"cuda_explicit_cached_grid", "fetch=l1", 0, fits_one_wave, 0, any_occupancy, true,
         "a step is hardly more than a launch, and lists compute no address"},
        // figure8.json: the box of 32^3 2.05, the fastest with a launch a step; 256^3 301 against 325 of
        // cuda_implicit_shared.
        {"cuda_implicit_cached", "fetch=l1", 0, any_number, 0, any_occupancy, true,
         "a lattice needs no lists, and L1 holds what neighbours share"},
        // tuning.json: 543 on the box of 256^3 against 1028 of cuda_explicit_cached; both take any springs.
        {"cuda_explicit_device", "fetch=l1", 0, any_number, 0, any_occupancy, true,
         "lists, which take springs beyond the lattice"},
        // fastest.json, where there is no CUDA: the heart 4.68 against 4.96 of vulkan_implicit and 5.28 of
        // gl_compute_implicit, the box of 32^3 4.40 against 3.67 of vulkan_implicit, 4.29 of
        // gl_compute_implicit.
        {"vulkan_explicit", "", fits_one_wave, 1e5, 0, sparse, true, "lists of active particles alone"},
        // fastest.json: the box of 256^3 286 against 298 of gl_compute_implicit and 543 of vulkan_explicit,
        // the heart of 1.9 million particles 59.4 against 57.5 and 66.6.
        {"vulkan_implicit", "", 0, any_number, 0, any_occupancy, true, "a lattice needs no lists"},
        {"vulkan_explicit", "", 0, any_number, 0, any_occupancy, true,
         "lists, which take springs beyond the lattice"},
        // fastest.json: the heart 5.28 against 5.64 of gl_compute_explicit, that of 1.9 million
        // particles 57.5 against 67.2.
        {"gl_compute_implicit", "", 0, any_number, 0, any_occupancy, true, "a lattice needs no lists"},
        {"gl_compute_explicit", "", 0, any_number, 0, any_occupancy, true,
         "lists, which take springs beyond the lattice"},
        // table1.json: 34.4 against 47.0 of gl_fragment_explicit, the heart 34.6 against 51.9.
        {"gl_fragment_implicit", "", 0, any_number, 0, any_occupancy, true,
         "a lattice needs no lists, and the stencil mask skips what is empty"},
        {"gl_fragment_explicit", "", 0, any_number, 0, any_occupancy, true,
         "lists, which take springs beyond the lattice"},
        // amd-epyc/fastest.json: several times the speed of OpenGL on the same processor.
        {"cpu_parallel", "", 0, any_number, 0, any_occupancy, true, "every core and its registers"},
        {"cpu_reference", "", 0, any_number, 0, any_occupancy, true,
         "lists, which take springs beyond the lattice"}};
    return list;
}

Workload workload_of(const Scene& scene) {
    return {scene.problem.lattice.voxel_count(), scene.problem.particle_count(), !scene.edits.empty(),
            scene.problem.has_tool()};
}

bool holds(const Rule& rule, const Workload& workload) {
    const auto particles = double(workload.particles);
    // A network of springs without a lattice is as sparse as can be.
    const double occupancy = workload.voxels == 0 ? 0 : workload.occupancy();
    return particles >= rule.min_particles && particles < rule.max_particles &&
           occupancy >= rule.min_occupancy && occupancy < rule.max_occupancy &&
           (rule.edits || !(workload.edited || workload.held));
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

void check_auto(const std::string& text) {
    check_options(text);
    // cpu_parallel has every formulation and precision that there is.
    const std::string options = options_of(text);
    if (!options.empty()) (void)BackendSpec::parse("cpu_parallel:" + options);
}

bool may_be_chosen(const Capabilities& capabilities) { return !capabilities.is_software; }

Chosen choose_by_rules(const std::string& text, const Scene& scene,
                       const std::function<bool(const BackendSpec&)>& takes) {
    check_auto(text);
    const Workload workload = workload_of(scene);
    const std::string options = options_of(text);
    for (const Rule& rule : rules()) {
        if (!holds(rule, workload) || registry().count(rule.backend) == 0) continue;
        const std::string both = options + (options.empty() || rule.tuning.empty() ? "" : ",") + rule.tuning;
        try {
            BackendSpec spec = BackendSpec::parse(rule.backend + (both.empty() ? "" : ":" + both));
            if (takes(spec)) return {std::move(spec), said(rule, workload)};
        } catch (const BadSpecification&) {
            // It does not have this formulation or precision.
        } catch (const Unavailable&) {
            // Its device is not here.
        }
    }
    throw Unavailable("no backend of this build takes the scene on a device of this machine");
}

AutoChoice choose_backend(const std::string& text, const Scene& scene,
                          const std::function<bool(const Backend&)>& accepts) {
    std::unique_ptr<Backend> backend;
    Chosen chosen = choose_by_rules(text, scene, [&](const BackendSpec& spec) {
        backend = spec.make();
        return may_be_chosen(backend->capabilities()) && accepts(*backend);
    });
    return {std::move(chosen), std::move(backend)};
}

nlohmann::json choose_among(const nlohmann::json& result, const std::vector<Row>& rows) {
    const Row& first = rows.front();
    const Identity& of = first.identity;
    const Workload workload{first.reference.value().voxels, first.workpiece.value().particles,
                            first.edits.has_value()};
    // A backend that has no row of this kind anywhere does not have the formulation or the precision.
    std::set<std::string> known, refused;
    for (const char* list : {"benchmarks", "skipped", "failed"}) {
        for (const Row& row : rows_from_json(result.at(list))) {
            if (row.identity.formulation != of.formulation || row.identity.precision != of.precision)
                continue;
            known.insert(row.identity.backend);
            if (row.reason && row.identity.scene == of.scene) refused.insert(row.identity.backend);
        }
    }
    const auto& backends = result.at("context").at("voxspring").at("backends");
    nlohmann::json choice = {{"name", nullptr}, {"reason", "no rule holds"}, {"times_fastest", nullptr}};
    for (const Rule& rule : rules()) {
        if (!holds(rule, workload) || !known.contains(rule.backend) || refused.contains(rule.backend) ||
            !backends.contains(rule.backend) || is_software(backends.at(rule.backend)))
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
