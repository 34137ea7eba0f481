// What every row of a result says about the accuracy of its run.
#pragma once

#include <cstdint>
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

/// What a row says of its accuracy; nothing where that is not known. results/schema.json defines each.
struct Errors {
    std::optional<double> relative_l2, max;       ///< rounding
    std::optional<std::uint64_t> worst_particle;  ///< whose rounding error `max` is
    std::optional<double> total_relative_l2, total_max,
        total_uncertainty;                    ///< against the converged solution
    std::optional<std::string> total_reason;  ///< why there are none of these
    std::optional<double> momentum, energy;
    bool chaotic = false;
    std::optional<double> divergence;
};
Errors errors_of(const ReferenceSolution& solution, const State& state, const Comparison& comparison);

/// Of a run that has none.
Errors no_errors(const ReferenceSolution& solution);

}  // namespace voxspring
