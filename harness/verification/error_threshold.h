// The spread: how far rounding carries a scene, measured by runs of the reference with rounding added.
// The gate: the bound above which an error is too large, in multiples of the spread and fractions of the
// motion.
#pragma once

#include <array>
#include <string>

#include "backends/backend.h"
#include "backends/registry.h"
#include "harness/verification/conserved.h"

namespace voxspring {

/// Describes what a backend rounds, and by how much.
struct RoundingModel {
    Formulation formulation = Formulation::position;
    Precision precision = Precision::float32;
    /// Relative error of roots and divisions, if the backend's options ask for approximate ones; otherwise 0.
    double root_error = 0;

    friend bool operator==(const RoundingModel&, const RoundingModel&) = default;
};
RoundingModel rounding_model_of(const BackendSpec& spec);
/// "increment/float32", followed by the error of roots if it is not 0.
std::string to_string(const RoundingModel& model);

/// The largest distances between the reference and runs of it that are rounded as a model says
/// (backends/cpu/perturbed_reference.h). One run rounds to nearest, the others at random. Lengths are in the
/// scene's unit.
struct Spread {
    double max = 0;  ///< largest distance of a particle
    double rms = 0;  ///< root mean square of the distances of all particles
    /// The largest distance of a particle of the reference from its start; `max` is compared with this.
    double motion_max = 0;
    double motion_rms = 0;
    double mean = 0;         ///< distance of the mean positions (Comparison::mean)
    double motion_mean = 0;  ///< how far the reference's mean position ends from its start
    std::array<double, Statistic::count> statistic{};  ///< largest Statistic::difference; 0 unless chaotic
    int runs = 0;
};

/// The number of random runs beside the one that rounds to nearest. It is three in general, and one for a
/// very large body, whose many particles are statistics enough. A small body has fifteen, since the largest
/// error of three runs would be a matter of luck, and further runs take little time.
int random_runs(std::size_t particles);

/// No finite bound by gate() or mean_gate() exceeds this share of the motion, unless the reference does not
/// move: a larger bound would pass a backend that computes something else.
constexpr double max_share_of_motion = 0.1;
/// The gate in multiples of the spread. A spread is the largest error of a few runs, and a correct backend's
/// error is about as large. docs/accuracy.md has the measurements.
constexpr double gate_in_spreads = 4;
/// A bound below this number of spreads cannot tell a wrong backend from rounding. Such a bound is not
/// applied.
constexpr double min_gate_in_spreads = 2;
/// Lower limit of the bound on a statistic of a chaotic scene, as a share of Statistic::size. A statistic
/// describes one moment of one trajectory, and is noisy because moments differ.
constexpr double min_statistics_share = 0.25;
/// Upper limit of a finite statistic_gate() as a share of Statistic::size. The spectrum of a backend that
/// leaves a body at rest differs by 1.
constexpr double max_statistics_share = 0.75;

/// The bound on an error with the given spread and motion. `admitted`, a length, is the error that the
/// options ask for, in addition to rounding; the cap at a share of the motion applies to the sum. Infinite if
/// rounding alone carries the scene so far that no bound would be meaningful.
double gate(double spread, double motion, double admitted);
/// mean_gate() is at least this share of the motion: by chance the error of a mean may be small in all the
/// few runs by which a spread is measured.
constexpr double min_share_of_mean = 0.02;
/// The bound on the error of the mean displacement over all particles. Rounding errors cancel in a mean, so
/// the mean shows a wrong gravity within a few steps of a large body, in which each particle moves by less
/// than a float32 position resolves.
double mean_gate(double spread, double motion, double admitted);
/// Whether rounding carries the scene so far that no displacement can be judged.
bool is_chaotic(const Spread& spread);
/// The bound on a statistic of a chaotic scene. Infinite if no bound would be meaningful.
double statistic_gate(double spread, double size);

}  // namespace voxspring
