// `--backend auto`: which backend to take for a dataset on the devices at hand.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/results/row.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// What the choice depends on beside the devices.
struct Workload {
    std::uint64_t voxels = 0, particles = 0;
    /// Of a scene whose springs are cut or joined between steps; infinite where none is.
    double steps_between_edits = std::numeric_limits<double>::infinity();
    bool held = false;  ///< by a tool, which moves between steps
    double occupancy() const { return double(particles) / double(voxels); }
};
Workload workload_of(const Scene& scene);

/// A rule: a backend and the workloads for which it is the fastest that was measured. Bounds are inclusive
/// below and exclusive above.
struct Rule {
    std::string backend;
    std::string tuning;  ///< "fetch=l1": what is not at its default; empty: nothing
    double min_particles, max_particles;
    double min_occupancy, max_occupancy;
    double min_steps_between_edits;  ///< infinite: only where there are none
    bool tool;                       ///< also where one moves
    std::string reason;              ///< as a user reads it
};
/// In the order in which they are asked: the first that holds, and whose backend is here and takes the
/// problem, decides; a graphics API in software never does. They are auto_rules.json, which
/// results/auto_rules.py makes of committed results.
const std::vector<Rule>& rules();
bool holds(const Rule& rule, const Workload& workload);

/// From how many particles on a body is stepped faster by several devices than by one.
struct SeveralDevices {
    std::string backend;
    int devices;
    double min_particles;
};
/// What committed results of `scaling` say, in auto_rules.json: nothing of what they have not measured.
const std::vector<SeveralDevices>& several_devices();
/// Empty, or what to do where several of the `here` devices that a backend has would be faster than one:
/// "2 devices are faster, see voxspring advise SCENE --devices 2".
std::string advice_on_devices(const std::vector<SeveralDevices>& measured, const std::string& backend,
                              const Workload& workload, int here);

/// "a full lattice of 134 million voxels", "29449 particles, 21% of 140760 voxels".
std::string describe(const Workload& workload);

/// What `--backend auto` takes.
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
                          const std::function<bool(const Backend&)>& accepts);
/// The same where nothing is to be constructed here: `takes` gives the capabilities of a backend that is
/// available, may be chosen and takes the scene, and nothing of others.
Chosen choose_by_rules(const std::string& text, const Scene& scene,
                       const std::function<std::optional<Capabilities>(const BackendSpec&)>& takes);
/// Whether the rules may choose it: a graphics API in software never.
bool may_be_chosen(const Capabilities& capabilities);
/// Checks what follows "auto". Throws BadSpecification.
void check_auto(const std::string& text);

/// The choice on the devices of a measured result, for the dataset that `rows`, medians of one scene,
/// formulation and precision, are of: `name` of the chosen row, `reason`, and how many times the time of the
/// fastest row it takes (`times_fastest`). `name` and `times_fastest` are null where what the rules take was
/// not measured.
nlohmann::json choose_among(const nlohmann::json& result, const std::vector<Row>& rows);

}  // namespace voxspring
