// The largest time step at which a backend is stable, found by trial and compared with theory.
#pragma once

#include <vector>

#include "harness/scene/scene.h"
#include "harness/study/suite.h"

namespace voxspring {

/// The largest stable time steps in theory, one per search of run_stability() (one start at one damping). An
/// element is 0 if nothing oscillates, or if the frequency is not known; run_stability() then leaves out that
/// search.
std::vector<double> stability_limits(const Scene& scene);

/// Finds a backend's largest stable time step by bisection, on the particles and springs of `scene` without
/// its gravity, loads, tool and damping. Compares the result with stable_time_step() of the body's true
/// frequency:
///
/// | start | damping | |
/// | --- | --- | --- |
/// | random within +-0.001 spacings | 0, 0.1, 1 | theory holds: within 0.2% |
/// | random within +-0.01, 0.1 and 0.3 spacings | 0 | springs' ends meet and springs turn: the limit falls |
/// | stretched to twice the size, +-0.001 | 0 | theory about the stretched state; the surface is pinned |
///
/// If the stretched body is not in equilibrium, between materials for example, constant loads hold it there:
/// theory requires a state of equilibrium. A backend that does not support loads then skips the stretched
/// start.
///
/// A time step counts as stable if, after a number of steps, no particle moves more than 30 times the start's
/// amplitude per step. Where theory holds, a mode of a random start grows to that size in these steps if the
/// time step exceeds theory by 0.1%. With `map` there is also a map: for each damping and time step, whether
/// a run stays bounded, gains energy or diverges.
///
/// Lists: `stability`, one row per start and damping; `stability_map`; `skipped`; and `failed`, the starts
/// and dampings for which theory holds but whose result differs from it by more than 0.2%. Rows are as in
/// results/schema.json. `limits` are stability_limits() of the scene. Throws what the backend throws.
void run_stability(const BackendSpec& spec, Backend& backend, const Scene& scene,
                   const std::vector<double>& limits, bool map, const Once& once);

}  // namespace voxspring
