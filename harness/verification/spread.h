// The spread: how far rounding carries a scene, measured by runs of the reference with random rounding added.
#pragma once

#include <array>
#include <string>

#include "backends/backend.h"
#include "backends/registry.h"
#include "harness/verification/statistics.h"

namespace voxspring {

/// Describes what a backend rounds, and by how much.
struct RoundingModel {
    Formulation formulation = Formulation::position;
    Precision precision = Precision::float32;
    /// Relative error of the approximate roots and divisions that its options ask for.
    double root_error = 0;

    friend bool operator==(const RoundingModel&, const RoundingModel&) = default;
};
RoundingModel rounding_model_of(const BackendSpec& spec);
/// "increment/float32", followed by the error of its roots if there is one.
std::string to_string(const RoundingModel& model);

/// The largest distances between the reference and runs of it that are rounded as a model says
/// (backends/cpu/perturbed_reference.h). One run rounds to nearest, the others at random. Lengths are in the
/// scene's unit.
struct Spread {
    double max = 0;  ///< of any particle
    double rms = 0;  ///< over all particles
    /// How far a particle of the reference ends from its start, of which `max` is a share.
    double motion_max = 0;
    double motion_rms = 0;
    std::array<double, Statistic::count> statistic{};  ///< differences of statistics(), for a chaotic scene
    int runs = 0;
};

/// The number of random runs beside the one that rounds to nearest. It is a few in general, and one for a
/// body whose many particles are statistics enough. It is more for a body of few particles: the largest of
/// three runs would be a matter of luck, and further runs take no time.
int random_runs(std::size_t particles);

}  // namespace voxspring
