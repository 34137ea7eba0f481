// Runs from random starts, and how far they grow: what the studies of stability and stress share.
#pragma once

#include "backends/backend.h"

namespace voxspring {

/// Every particle that can move displaced by uniform components within +-`amplitude`, at no speed; the same
/// each time.
State random_start(const Problem& problem, double amplitude);

/// The farthest that a particle moves in the last step; infinite where any is not finite.
double farthest(const State& state);

/// Amplitude of a start for which theory holds, in spacings, and what a bounded run stays under, in
/// amplitudes of its start. A float32 position at 16 spacings resolves a thousandth of 0.001, so that a
/// mode's share of the start is not rounded away; 30 times 0.001 is still less than where springs that are
/// not linear stop the growth of a damped mode, 0.07 to 0.2.
constexpr double small_amplitude = 1e-3;
constexpr double max_growth = 30;

/// Steps in which a mode of a random start comes to move max_growth times the start's amplitude a step, if
/// the time step is 1 + `excess` times its limit: by the root of z^2 - (2 - lambda - W) z + 1 - lambda = 0
/// beyond -1, W = omega^2 dt^2 = (4 - 2 lambda) (1 + excess)^2.
int steps_to_grow(const Problem& problem, double excess);

/// The state `steps` after `start`.
State run_from(const State& start, const Problem& problem, Backend& backend, int steps);

/// Total energy before the next step, which is taken: its velocity is the mean of those of half a step before
/// and after, without which the energy of a fast mode is out by up to a third.
double energy_before_step(const Problem& problem, Backend& backend);

}  // namespace voxspring
