// `--backend auto`: which backend to use for a dataset on the devices of this machine.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/results/row.h"
#include "harness/scene/scene.h"

namespace voxspring {

class Result;

/// What the choice of a backend depends on, apart from the devices of this machine.
struct Workload {
    std::uint64_t voxels = 0, particles = 0;
    /// Mean number of steps between two edits that cut or join springs; infinite if the scene has no edits.
    double steps_between_edits = std::numeric_limits<double>::infinity();
    bool held = false;       ///< whether a tool holds particles and moves them
    bool increments = true;  ///< by_increments() of the formulation
    double occupancy() const { return double(particles) / double(voxels); }
};
Workload workload_of(const Scene& scene, Formulation formulation);

/// A backend and the workloads for which the rule names it. If several rules hold, the one whose backend was
/// measured fastest comes first. `min_` bounds are inclusive, `max_` exclusive.
struct Rule {
    std::string backend;
    std::string tuning;  ///< parameters that differ from the defaults: "fetch=l1"; may be empty
    double min_particles, max_particles;
    double min_occupancy, max_occupancy;
    double min_steps_between_edits;  ///< infinite: the rule is only for scenes without edits
    bool increments;                 ///< what by_increments() of the formulation must be
    bool tool;                       ///< whether the rule also holds if a tool moves
    std::string reason;              ///< why the backend is fast, as text for users
};
/// The rules in order of preference. The choice is the first rule that holds for the workload and whose
/// backend is available, accepts the problem and is not outpaced (backends/outpaced.h). Graphics APIs in
/// software are never chosen. results/auto_rules.py makes the rules (auto_rules.json) from committed results.
const std::vector<Rule>& rules();
bool holds(const Rule& rule, const Workload& workload);

/// A workload in words: "a full lattice of 134 million voxels", "29449 particles in 21% of 140760 voxels".
std::string describe(const Workload& workload);

/// What `--backend auto` has chosen, and why.
struct Chosen {
    BackendSpec spec;
    std::string reason;  ///< "cuda_march:fetch=l1, a full lattice ...: each thread marches along ..."
};
struct AutoChoice : Chosen {
    std::unique_ptr<Backend> backend;
};

/// Whether `text` asks for a choice: "auto" or "auto:...".
bool asks_for_auto(const std::string& text);
/// Chooses the backend for `text`, "auto[:formulation=...,precision=...]", by the rules. `accepts` says
/// whether a backend can run the scene (SceneRunner::unsupported). Throws BadSpecification for other keys,
/// and Unavailable if no backend on this machine takes the scene.
AutoChoice choose_backend(const std::string& text, const Scene& scene,
                          const std::function<bool(Backend&)>& accepts);
/// Like choose_backend(), but constructs no backend in this process. `takes` says whether a backend is
/// available, may be chosen, takes the scene and is not outpaced.
Chosen choose_by_rules(const std::string& text, const Scene& scene,
                       const std::function<bool(const BackendSpec&)>& takes);
/// What Chosen::reason adds about a backend that the rules prefer, but that is outpaced because of `why`.
std::string passed_over_text(const BackendSpec& spec, const std::string& why);
/// Whether the rules may choose a backend: false for a graphics API that runs in software.
bool may_be_chosen(const Capabilities& capabilities);
/// Checks the options that follow "auto", and returns the formulation. Throws BadSpecification.
Formulation check_auto(const std::string& text);

/// What `--backend auto` would choose on the devices of a measured result. `rows` are the medians of one
/// scene, formulation and precision. Returns the `name` of the chosen row, the `reason`, and the row's time
/// as a multiple of the fastest row's time (`times_fastest`). `name` and `times_fastest` are null if no rule
/// holds, or if what the rules choose was not measured.
nlohmann::json choose_among(const Result& result, const std::vector<Row>& rows);

}  // namespace voxspring
