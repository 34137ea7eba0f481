// Runs from random starts, and how far they grow. The studies of stability and stress share them.
#pragma once

#include "backends/backend.h"

namespace voxspring {

/// A state in which every particle that can move is displaced by uniform random components within
/// +-`amplitude`, at rest. It is the same for every call.
State random_start(const Problem& problem, double amplitude);

/// A random start within a tenth of the shortest spacing or spring, which strains every spring.
State strained_start(const Problem& problem);

/// The largest movement of a particle in the last step; infinite if any value is not finite.
double farthest(const State& state);

/// `small_amplitude`, in spacings, is that of a start for which theory holds. `max_growth` is the largest
/// movement per step of a bounded run, in amplitudes of its start. A float32 position at 16 spacings resolves
/// a thousandth of 0.001, so a mode's share of the start is not rounded away. 30 times 0.001 is still less
/// than the 0.07 to 0.2 at which nonlinear springs stop the growth of a damped mode.
constexpr double small_amplitude = 1e-3;
constexpr double max_growth = 30;

/// The number of steps until a mode of a random start moves max_growth times the start's amplitude per step,
/// if the time step is 1 + `excess` times its limit. The growth per step is the root beyond -1 of z^2 - (2 -
/// lambda - W) z + 1 - lambda = 0, with W = omega^2 dt^2 = (4 - 2 lambda) (1 + excess)^2.
int steps_to_grow(const Problem& problem, double excess);

/// The state `steps` steps after `start`.
State run_from(const State& start, const Problem& problem, Backend& backend, int steps);

/// Makes a step, and returns the total energy before it. The velocity used is the mean of the velocities half
/// a step before and half a step after that time; otherwise the energy of a fast mode would be wrong by up to
/// a third.
double energy_before_step(const Problem& problem, Backend& backend);

}  // namespace voxspring
