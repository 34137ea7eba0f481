// The gate: the bound above which an error is too large, in spreads and shares of the motion.
#pragma once

#include "harness/verification/spread.h"

namespace voxspring {

/// No bound exceeds this share of the motion. A larger bound would pass a backend that computes something
/// else.
constexpr double max_share_of_motion = 0.1;
/// The gate in spreads. A spread is the largest of a few runs, and the error of correct arithmetic is about
/// as large. docs/accuracy.md has the measurements.
constexpr double gate_in_spreads = 4;
/// A bound below this number of spreads cannot tell a wrong backend from rounding, and is not applied.
constexpr double min_gate_in_spreads = 2;
/// Lower limit of the bound on statistics of a chaotic scene, as a share of their size. A statistic is from
/// one moment of one trajectory, and is noisy because such moments differ.
constexpr double min_statistics_share = 0.25;
/// Upper limit of that bound: a backend that does nothing differs by 1.
constexpr double max_statistics_share = 0.75;

/// The bound on an error with the given spread and motion. `admitted`, a length, is the error that the
/// options ask for, in addition to rounding; the cap at a share of the motion applies to the sum. Infinite if
/// rounding alone carries the scene so far that no bound would be meaningful.
double gate(double spread, double motion, double admitted);
/// Whether rounding carries the scene so far that no displacement can be judged.
bool is_chaotic(const Spread& spread);
/// The bound on a statistic of a chaotic scene. Infinite if the statistic is as chaotic as the particles.
double statistic_gate(double spread, double size);

}  // namespace voxspring
