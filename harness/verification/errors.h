// Judges the accuracy of a run, for every row of a result.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/scene/scene.h"
#include "harness/verification/conserved.h"
#include "harness/verification/error_threshold.h"
#include "harness/verification/reference.h"
#include "harness/verification/verify.h"

namespace voxspring {

/// The reference with which runs of a scene are compared after a number of steps.
struct ReferenceSolution {
    const Problem& problem;  ///< the problem after the edits within `steps` steps
    int steps = 0;
    State same_step;     ///< float64 at the same time step; the difference from it is the rounding error
    Refined refined;     ///< float64 in the limit of time step 0; the difference from it is the total error
    const State& start;  ///< the state at which the runs began
    /// The spread of each rounding model. Runs whose model is missing are only required to be finite.
    std::vector<std::pair<RoundingModel, Spread>> spreads = {};
    // Conserved quantities and, if the scene is chaotic, the summary of same_step. They are computed on
    // demand.
    mutable std::optional<Conserved> conserved = {};
    mutable std::optional<StateSummary> summary = {};
    mutable std::map<double, double> strained_shares =
        {};  ///< results of strained_share(), by the accepted error
};
/// The spread of the rounding model `model`; null if `solution` has none for this model.
const Spread* spread_of(const ReferenceSolution& solution, const RoundingModel& model);

/// The result of judge().
struct JudgedState : Comparison {
    std::optional<Energy> energy;  ///< energy of the state, if judge() computed it
};

/// Compares a state with the reference. The largest difference and the root mean square are each judged by
/// gate(), and the mean by mean_gate() (error_threshold.h), which admit the error that tuning options ask for
/// (such as `sleep`, which stops slow tiles). In a chaotic scene none of the three is judged: the state fails
/// only if it is not finite or one of its statistics exceeds statistic_gate().
JudgedState judge(const ReferenceSolution& solution, const State& state, const BackendSpec& spec);

/// The least strained_share() with which a run verifies a backend.
constexpr double min_strained_share = 0.5;
/// The share of the springs whose length at the end of the reference run differs from the rest length by more
/// than the error that a backend may have. A backend that leaves these springs out would fail. The error that
/// it may have is the smaller of the bounds on the largest error and on the root mean square error. The
/// result is 0 if no displacement is judged, and 1 if there are no springs.
double strained_share(const ReferenceSolution& solution, const BackendSpec& spec);

/// The accuracy that a row reports. Unknown values are absent. results/schema.json defines each field.
struct Errors {
    std::optional<double> relative_l2, max;       ///< rounding error
    std::optional<std::uint64_t> worst_particle;  ///< the particle whose rounding error is `max`
    std::optional<double> total_relative_l2, total_max,
        total_uncertainty;                    ///< against the converged solution
    std::optional<std::string> total_reason;  ///< why the total errors are absent
    std::optional<double> momentum, energy;   ///< drift() from the reference
    bool chaotic = false;
    std::optional<double> spread;  ///< Spread::rms / motion_rms for the row's rounding model
};
Errors errors_of(const ReferenceSolution& solution, const State& state, const JudgedState& judged,
                 const BackendSpec& spec);

/// What a row reports if the errors of its run are not known.
Errors no_errors(const ReferenceSolution& solution, const BackendSpec& spec);

}  // namespace voxspring
