// The largest time step at which a backend is stable, found by trial and compared with theory.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "harness/scene/scene.h"
#include "harness/study/suite.h"

namespace voxspring {

/// Finds a backend's largest stable time step by bisection, on the particles and springs of `scene` without
/// its gravity, loads and damping. Compares it with stable_time_step() of the true frequency:
///
/// | start | damping | |
/// | --- | --- | --- |
/// | random within +-0.001 of the spacing | 0, 0.1, 1 | theory holds: within 0.2% |
/// | random within +-0.01, 0.1, 0.3 | 0 | springs meet and turn: the limit falls |
/// | twice the size of rest, and +-0.001 | 0 | theory about the stretched state; the surface is pinned |
///
/// If the stretched body is not in equilibrium, between materials for example, constant loads hold it there:
/// theory requires a state of equilibrium. A backend that does not support loads skips that start.
///
/// A time step counts as stable if, after a number of steps, no particle moves more than 30 times the start's
/// amplitude per step. Where theory holds, a mode of a random start grows to that size in these steps if the
/// time step exceeds theory by 0.1%. With `map` there is also a map of damping against time step.
///
/// Lists: `stability`, one row per start and damping; `stability_map`; and `failed`, the starts and dampings
/// whose result differs from theory by more than 0.2%. Rows are as in results/schema.json.
class StabilityStudy {
public:
    /// Largest stable time steps in theory, one per search. An element is empty if nothing oscillates, or if
    /// the frequency is not known.
    using Limits = std::vector<std::optional<double>>;
    static Limits limits_of(const Scene& scene);

    StabilityStudy(const Scene& scene, const Limits& limits);
    explicit StabilityStudy(const Scene& scene) : StabilityStudy(scene, limits_of(scene)) {}
    /// Runs all searches and, with `map`, the map. Throws what the backend throws.
    void run(const BackendSpec& spec, Backend& backend, bool map, const Once& once);

private:
    struct Search;
    static std::vector<Search> planned_searches(const Scene& scene);
    Rows search(const BackendSpec& spec, Backend& backend, Search& search) const;

    std::string scene_;
    std::vector<std::shared_ptr<Search>> searches_;
};

}  // namespace voxspring
