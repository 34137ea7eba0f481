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

/// What the choice depends on apart from the devices.
struct Workload {
    std::uint64_t voxels = 0, particles = 0;
    /// Steps between two edits that cut or join springs; infinite if the scene has no edits.
    double steps_between_edits = std::numeric_limits<double>::infinity();
    bool held = false;       ///< whether a tool holds particles, and moves between steps
    bool increments = true;  ///< by_increments() of the formulation
    double occupancy() const { return double(particles) / double(voxels); }
};
Workload workload_of(const Scene& scene, Formulation formulation);

/// A rule: a backend, and the workloads for which it was the fastest one measured. Bounds are inclusive below
/// and exclusive above.
struct Rule {
    std::string backend;
    std::string tuning;  ///< "fetch=l1": what differs from the defaults; may be empty
    double min_particles, max_particles;
    double min_occupancy, max_occupancy;
    double min_steps_between_edits;  ///< infinite: the rule is only for scenes without edits
    bool increments;                 ///< by_increments() of the formulations it is for
    bool tool;                       ///< whether the rule also holds if a tool moves
    std::string reason;              ///< as text for users
};
/// The rules in order. The first one that holds, and whose backend is available, takes the problem and is not
/// outpaced (backends/outpaced.h), decides. A graphics API in software is never chosen. The rules are in
/// auto_rules.json, which results/auto_rules.py makes from committed results.
const std::vector<Rule>& rules();
bool holds(const Rule& rule, const Workload& workload);

/// A workload in words: "a full lattice of 134 million voxels", "29449 particles, 21% of 140760 voxels".
std::string describe(const Workload& workload);

/// The choice of `--backend auto`.
struct Chosen {
    BackendSpec spec;
    std::string reason;  ///< "cuda_march:fetch=l1, a full lattice ...: threads that march along columns ..."
};
struct AutoChoice : Chosen {
    std::unique_ptr<Backend> backend;
};

/// Whether `text` asks for a choice: "auto" or "auto:...".
bool asks_for_auto(const std::string& text);
/// The choice that `text`, "auto[:formulation=...,precision=...]", leaves to the rules on this machine.
/// `accepts` says whether a backend can run the scene (SceneRunner::unsupported). Throws BadSpecification for
/// other keys, and Unavailable if no backend of this build takes the scene.
AutoChoice choose_backend(const std::string& text, const Scene& scene,
                          const std::function<bool(Backend&)>& accepts);
/// choose_backend() without constructing a backend in this process. `takes` says whether a backend is
/// available, may be chosen, takes the scene and is not outpaced.
Chosen choose_by_rules(const std::string& text, const Scene& scene,
                       const std::function<bool(const BackendSpec&)>& takes);
/// The text in a choice's reason about a backend that the rules prefer but that is outpaced (outpaced.h).
std::string passed_over_text(const BackendSpec& spec, const std::string& why);
/// Whether the rules may choose a backend: false for a graphics API that runs in software.
bool may_be_chosen(const Capabilities& capabilities);
/// Checks the options that follow "auto". Throws BadSpecification.
Formulation check_auto(const std::string& text);

/// What `--backend auto` would choose on the devices of a measured result. `rows` are the medians of one
/// scene, formulation and precision. Returns the `name` of the chosen row, the `reason`, and the row's time
/// as a multiple of the fastest row's time (`times_fastest`). `name` and `times_fastest` are null if what the
/// rules choose was not measured.
nlohmann::json choose_among(const Result& result, const std::vector<Row>& rows);

}  // namespace voxspring
