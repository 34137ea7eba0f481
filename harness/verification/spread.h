// How far rounding carries a scene: measured, by running the reference with rounding put in at random.
#pragma once

#include <array>
#include <string>

#include "backends/backend.h"
#include "backends/registry.h"
#include "harness/verification/statistics.h"

namespace voxspring {

/// What a backend rounds, and how much.
struct RoundingModel {
    Formulation formulation = Formulation::position;
    Precision precision = Precision::float32;
    double root_error = 0;  ///< of approximate roots and divisions that its options ask for

    friend bool operator==(const RoundingModel&, const RoundingModel&) = default;
};
RoundingModel rounding_model_of(const BackendSpec& spec);
/// "increment/float32", and what its roots are off by.
std::string to_string(const RoundingModel& model);

/// The largest distances between the reference and runs of it that are rounded as a model rounds
/// (backends/cpu/perturbed_reference.h): one to nearest, the others at random. Lengths are in the scene's
/// unit.
struct Spread {
    double max = 0;  ///< of any particle
    double rms = 0;  ///< over all particles
    double motion_max =
        0;  ///< what they are a share of: how far a particle of the reference ends from its start
    double motion_rms = 0;
    std::array<double, Statistic::count> statistic{};  ///< differences of statistics(), of a chaotic scene
    int runs = 0;
};

/// How many random runs beside the one to nearest: a few; one of a body whose many particles say as much in
/// it; more of a few particles, whose largest of three would be a matter of luck, and which take no time.
int random_runs(std::size_t particles);

/// Nothing stands above this share of the motion: a bound beyond it would let a backend pass that does
/// something else.
constexpr double max_share_of_motion = 0.1;
/// The gate, in spreads. Of a few runs the largest is about what honest arithmetic is off by: 0.2 to 1.4 of
/// it was measured (docs/accuracy.md).
constexpr double gate_in_spreads = 4;
/// A bound this near to the spread cannot tell a wrong backend from rounding, and is not applied.
constexpr double min_gate_in_spreads = 2;
/// What statistics of a chaotic scene may differ by at least, as a share of their size: they are of one
/// moment of one trajectory, and what such moments differ by is their noise.
constexpr double min_statistics_share = 0.25;
/// And at most: who does nothing differs by all of it.
constexpr double max_statistics_share = 0.75;

/// The bound on an error whose spread and motion are given; `admitted`, a length, is allowed on top.
/// Infinite where rounding alone carries the scene so far that no bound would say anything.
double gate(double spread, double motion, double admitted);
/// Whether rounding of that kind carries the scene so far that no displacement can be judged.
bool is_chaotic(const Spread& spread);
/// The bound on a statistic of a chaotic scene. Infinite where it is as chaotic as the particles.
double statistic_gate(double spread, double size);

}  // namespace voxspring
