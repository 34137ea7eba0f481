// Random starts, for the studies of stability and stress and for verifying backends, and how far runs grow.
#pragma once

#include "backends/backend.h"

namespace voxspring {

/// A state without velocity in which each component of the displacement of every particle that can move is
/// random, uniform within +-`amplitude`. Every call returns the same state.
State random_start(const Problem& problem, double amplitude);

/// random_start() with a tenth of the shortest spacing as its amplitude; without a lattice, a tenth of the
/// shortest rest length. Strains every spring that has an end that can move.
State strained_start(const Problem& problem);

/// The longest increment: how far a particle moved in the last step. Infinite if any value is not finite.
double farthest(const State& state);

/// Amplitude, in spacings, of a start that is small enough for linear theory. A float32 position at 16
/// spacings resolves a thousandth of it, so a mode's share of the start is not rounded away.
constexpr double small_amplitude = 1e-3;
/// A run is unstable if a particle moves in one step by more than this many amplitudes of the start. 30 times
/// small_amplitude is less than the 0.07 to 0.2 spacings at which nonlinear springs end a mode's growth.
constexpr double max_growth = 30;

/// The number of steps until a mode of a random start moves max_growth times the start's amplitude per step,
/// if the time step is (1 + `excess`) times the stability limit. The growth per step is the magnitude of the
/// root below -1 of z^2 - (2 - lambda - W) z + 1 - lambda = 0, with W = omega^2 dt^2 = (4 - 2 lambda) (1 +
/// excess)^2.
int steps_to_grow(const Problem& problem, double excess);

/// The state `steps` steps after `start`.
State run_from(const State& start, const Problem& problem, Backend& backend, int steps);

/// Makes a step, and returns the total energy before the step. Its velocity is the mean of the velocities
/// half a step before and half a step after that time. With either alone the energy of a fast mode would be
/// wrong by up to a third.
double energy_before_step(const Problem& problem, Backend& backend);

}  // namespace voxspring
