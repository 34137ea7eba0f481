// What counts as too large an error: the gate, in spreads and shares of the motion.
#pragma once

#include "harness/verification/spread.h"

namespace voxspring {

/// Nothing stands above this share of the motion: a bound beyond it would let a backend pass that does
/// something else.
constexpr double max_share_of_motion = 0.1;
/// The gate, in spreads. Of a few runs the largest is about what honest arithmetic is off by;
/// docs/accuracy.md has what was measured.
constexpr double gate_in_spreads = 4;
/// A bound this near to the spread cannot tell a wrong backend from rounding, and is not applied.
constexpr double min_gate_in_spreads = 2;
/// What statistics of a chaotic scene may differ by at least, as a share of their size: they are of one
/// moment of one trajectory, and what such moments differ by is their noise.
constexpr double min_statistics_share = 0.25;
/// And at most: who does nothing differs by all of it.
constexpr double max_statistics_share = 0.75;

/// The bound on an error whose spread and motion are given; `admitted`, a length, is what the options ask
/// for, on top of rounding. The cap at a share of the motion holds for both together. Infinite where rounding
/// alone carries the scene so far that no bound would say anything.
double gate(double spread, double motion, double admitted);
/// Whether rounding of that kind carries the scene so far that no displacement can be judged.
bool is_chaotic(const Spread& spread);
/// The bound on a statistic of a chaotic scene. Infinite where it is as chaotic as the particles.
double statistic_gate(double spread, double size);

}  // namespace voxspring
