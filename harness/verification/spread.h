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

}  // namespace voxspring
