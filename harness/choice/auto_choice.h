// For `--backend auto`: chooses the backend for a scene on the devices of this machine.
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

/// The properties of a scene and a formulation that the choice of a backend depends on.
struct Workload {
    std::uint64_t voxels = 0, particles = 0;
    /// Mean number of steps per edit that cuts or joins springs; infinite if the scene has no edits.
    double steps_between_edits = std::numeric_limits<double>::infinity();
    bool increments = true;  ///< whether the state has the increments of particles: by_increments()
    double occupancy() const { return double(particles) / double(voxels); }
};
Workload workload_of(const Scene& scene, Formulation formulation);

/// A rule of the choice: a backend, and the workloads for which it may be chosen. If several rules hold for a
/// workload, those of one API stand together in rules(), the API with the fastest row of all first. Among
/// them the rule whose backend was measured fastest comes first. The bounds `min_...` are inclusive,
/// `max_...` exclusive.
struct Rule {
    std::string backend;
    std::string tuning;  ///< tuning parameters that differ from the defaults: "fetch=l1"; may be empty
    double min_particles, max_particles;
    double min_occupancy, max_occupancy;
    double min_steps_between_edits;  ///< infinite: the rule is only for scenes without edits
    bool increments;                 ///< what Workload::increments must be
};
/// The rules in order of preference. The choice is the backend of the first rule that holds for the workload
/// and whose backend is available, supports the problem and is not outpaced: predicted to be slower than
/// another backend (backends/outpaced.h). Graphics APIs in software are never chosen. results/auto_rules.py
/// makes the rules (auto_rules.json) from committed results.
const std::vector<Rule>& rules();
bool holds(const Rule& rule, const Workload& workload);

/// A workload as text: "a full lattice of 134 million voxels", "29449 particles in 21% of 140760 voxels".
std::string describe(const Workload& workload);

/// The backend that `--backend auto` has chosen, and why.
struct Chosen {
    BackendSpec spec;
    std::string reason;  ///< "cuda_march, a full lattice ...: each thread marches along ..."
};
struct AutoChoice : Chosen {
    std::unique_ptr<Backend> backend;
};

/// Whether `text`, the argument of --backend, asks for a choice by the rules: "auto" or "auto:...".
bool asks_for_auto(const std::string& text);
/// Chooses a backend by the rules. `text` is "auto[:formulation=...,precision=...]". `accepts` returns
/// whether a backend can run the scene (SceneRunner::unsupported). Throws BadSpecification if `text` has
/// other keys or values, and Unavailable if no backend on this machine can run the scene.
AutoChoice choose_backend(const std::string& text, const Scene& scene,
                          const std::function<bool(Backend&)>& accepts);
/// Like choose_backend(), but constructs no backend in this process. `takes` returns whether a backend is
/// available, may be chosen, can run the scene and is not outpaced.
Chosen choose_by_rules(const std::string& text, const Scene& scene,
                       const std::function<bool(const BackendSpec&)>& takes);
/// The text in Chosen::reason about a backend that the rules prefer but that is outpaced, for the reason
/// `why`.
std::string passed_over_text(const BackendSpec& spec, const std::string& why);
/// Whether the rules may choose a backend: false for a graphics API that runs in software.
bool may_be_chosen(const Capabilities& capabilities);
/// Checks the options that follow "auto", and returns the formulation. Throws BadSpecification.
Formulation check_auto(const std::string& text);

/// What `--backend auto` would choose on the devices of a measured result if no backend were outpaced. `rows`
/// are the medians of one scene, formulation and precision. Returns a JSON object with the `name` of the
/// chosen row, the `reason`, and `times_fastest`: the row's time as a multiple of the fastest row's time.
/// `name` and `times_fastest` are null if no rule holds, or if the backend and tuning that the rules choose
/// were not measured.
nlohmann::json choose_among(const Result& result, const std::vector<Row>& rows);

}  // namespace voxspring
