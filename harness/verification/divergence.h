// When a run counts as diverged, and after which step it did.
#pragma once

#include <optional>
#include <string>

#include "backends/backend.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {

/// The farthest that a particle of a run within its bounds moves in one step, in units of length:
///
///     l + |v_0| + 2 |u_0| + 4 |d| + s + dt^2 (|g| + |load / m|) n
///
/// l is the longest rest length, v_0 the longest increment and u_0 the longest displacement of the start, s
/// the largest strain of a spring at rest (a length), d the farthest that a tool moves (its springs
/// accelerate by no more than omega^2 d), n the `steps`, or the 1 / lambda within which damping balances a
/// constant force if that is less. An energy bound: below the stability limit, omega dt < 2, a mode of
/// amplitude A moves by no more than 2 A a step, A being the start's or half the strain's; what a constant
/// force adds to the increment in n steps is n dt^2 of it. One rest length a step is room for springs that
/// meet. A run that diverges grows by a factor a step, so that the room costs few steps.
double largest_increment(const Scene& scene, int steps, const State& start);
inline double largest_increment(const Scene& scene, int steps) {
    return largest_increment(scene, steps, scene.state);
}

/// What every run of the harness is held to: largest_increment(), checked every 64 steps.
DivergenceMonitor divergence_monitor(const Scene& scene, int steps, const State& start);
inline DivergenceMonitor divergence_monitor(const Scene& scene, int steps) {
    return divergence_monitor(scene, steps, scene.state);
}

/// Where the run of `steps` since the last rewind(), which left `last`, departed from its bounds, if it has:
/// as the backend saw it, or between its last check and `last`. The step is found by playing the scene once
/// more checked after every step, unless that takes more than a million steps. A `last` that is not finite
/// and that the second run does not confirm is left to compare(). Leaves `monitor` set.
std::optional<Divergence> find_divergence(Backend& backend, SceneRunner& runner,
                                          const DivergenceMonitor& monitor, const State& last, int steps);

/// "diverged at step 128: ...", or "between steps 64 and 128".
std::string describe(const Divergence& divergence, const DivergenceMonitor& monitor);

}  // namespace voxspring
