// Decides whether a run has diverged, and finds the step after which it did.
#pragma once

#include <optional>
#include <string>

#include "backends/backend.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {

/// An upper bound on how far a particle of a run that has not diverged moves in one step, in units of length:
///
///     l + |v_0| + 2 |u_0| + 4 |d| + s + dt^2 (|g| + |load / m|) n
///
/// Here l is the longest rest length, v_0 the longest increment and u_0 the longest displacement of the
/// start, s the largest strain of a spring at rest (a length), and d the farthest that a tool moves; the
/// tool's springs accelerate a particle by at most omega^2 d. n is the smaller of `steps` and 1 / lambda, the
/// number of steps in which damping balances a constant force. The sum is an energy bound. Below the
/// stability limit, omega dt < 2, a mode of amplitude A moves by at most 2 A per step, where A is the
/// amplitude of the start or half the strain. A constant force adds n dt^2 times the acceleration to the
/// increment in n steps. One rest length per step is a margin for springs whose ends meet. A diverging run
/// grows by a factor per step, so the margin delays its detection by few steps only.
double largest_increment(const Scene& scene, int steps, const State& start);
inline double largest_increment(const Scene& scene, int steps) {
    return largest_increment(scene, steps, scene.state);
}

/// The monitor of a whole run: after about every 64 steps (DivergenceMonitor::every) it checks that no
/// particle exceeds largest_increment().
DivergenceMonitor divergence_monitor(const Scene& scene, int steps, const State& start);
inline DivergenceMonitor divergence_monitor(const Scene& scene, int steps) {
    return divergence_monitor(scene, steps, scene.state);
}

/// Finds the step at which a run left the bounds of `monitor`; empty if it did not. The run made `steps`
/// steps since the last rewind() and ended in the state `last`. To find the step between two checks, the
/// scene runs once more and is checked after every step. If that takes more than a million steps, the result
/// is the interval between the checks. If only `last` is not finite, the result may be empty; judge() and
/// compare() then fail the state. If the scene ran once more, the backend has `monitor` as its monitor
/// afterwards.
std::optional<Divergence> find_divergence(Backend& backend, SceneRunner& runner,
                                          const DivergenceMonitor& monitor, const State& last, int steps);

/// "diverged at step 128: ...", or "diverged between steps 64 and 128: ...".
std::string describe(const Divergence& divergence, const DivergenceMonitor& monitor);

}  // namespace voxspring
