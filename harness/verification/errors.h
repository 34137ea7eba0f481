// What every row of a result says about the accuracy of its run.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "backends/registry.h"
#include "harness/scene/scene.h"
#include "harness/verification/conserved.h"
#include "harness/verification/reference.h"
#include "harness/verification/verify.h"

namespace voxspring {

/// What the runs of a scene after a number of steps are held against.
struct ReferenceSolution {
    const Problem& problem;  ///< as the edits until then leave it
    int steps = 0;
    State same_step;  ///< float64 at the same time step: the rounding error is the difference from it
    Refined refined;  ///< float64 without a time step: the total error is
    Chaos chaos;
    Conserved conserved = {};  ///< of same_step
};

/// compare() with the truth, admitting the error that a tuning asks for (`sleep`); where float64 itself
/// diverges no error fails, unless the state is not finite.
Comparison judge(const ReferenceSolution& solution, const State& state, const BackendSpec& spec);

/// error_relative_l2, error_max and worst_particle, the rounding error; total_error_relative_l2,
/// total_error_max, total_error_uncertainty and total_error_reason; momentum_error, energy_error; chaotic and
/// divergence. results/schema.json defines each.
nlohmann::json error_fields(const ReferenceSolution& solution, const State& state,
                            const Comparison& comparison);

/// The same fields of a run that has no errors.
nlohmann::json no_error_fields(const ReferenceSolution& solution);

/// JSON has neither infinity nor NaN.
nlohmann::json number_or_null(double value);

}  // namespace voxspring
