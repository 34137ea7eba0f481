// What every row of a result says about the accuracy of its run.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/scene/scene.h"
#include "harness/verification/conserved.h"
#include "harness/verification/reference.h"
#include "harness/verification/spread.h"
#include "harness/verification/verify.h"

namespace voxspring {

/// What the runs of a scene after a number of steps are held against.
struct ReferenceSolution {
    const Problem& problem;  ///< as the edits until then leave it
    int steps = 0;
    State same_step;     ///< float64 at the same time step: the rounding error is the difference from it
    Refined refined;     ///< float64 without a time step: the total error is
    const State& start;  ///< where the runs began
    Conserved conserved = {};  ///< of same_step
    /// Of what backends' runs round; where a model is missing they are only held to be finite.
    std::vector<std::pair<RoundingModel, Spread>> spreads = {};
    mutable std::optional<StateSummary> summary =
        {};  ///< of same_step; judge() makes it where it asks for it
};
/// Null where there is none.
const Spread* spread_of(const ReferenceSolution& solution, const RoundingModel& model);

/// The differences from the reference, each against its gate() (error_threshold.h), which admits the error
/// that a tuning asks for (`sleep`): the largest and the root mean square. Of a chaotic scene neither is
/// judged, and the state fails only where it is not finite or one of its statistics exceeds statistic_gate().
Comparison judge(const ReferenceSolution& solution, const State& state, const BackendSpec& spec);

/// What a row says of its accuracy; nothing where that is not known. results/schema.json defines each.
struct Errors {
    std::optional<double> relative_l2, max;       ///< rounding
    std::optional<std::uint64_t> worst_particle;  ///< whose rounding error `max` is
    std::optional<double> total_relative_l2, total_max,
        total_uncertainty;                    ///< against the converged solution
    std::optional<std::string> total_reason;  ///< why there are none of these
    std::optional<double> momentum, energy;
    bool chaotic = false;
    std::optional<double> spread;  ///< of the row's rounding model, rms, as a share of the motion
};
Errors errors_of(const ReferenceSolution& solution, const State& state, const Comparison& comparison,
                 const BackendSpec& spec);

/// Of a run that has none.
Errors no_errors(const ReferenceSolution& solution, const BackendSpec& spec);

}  // namespace voxspring
