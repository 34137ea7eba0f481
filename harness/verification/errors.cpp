#include "harness/verification/errors.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

namespace voxspring {

namespace {

/// The error that the options of `spec` ask for, in units of length.
double admitted_error(const Problem& problem, const BackendSpec& spec, int steps) {
    const glm::dvec3 spacing = problem.lattice.spacing;
    return steps * spec.admitted_spacings_per_step() * std::min({spacing.x, spacing.y, spacing.z});
}

}  // namespace

Comparison judge(const ReferenceSolution& solution, const State& state, const BackendSpec& spec) {
    Comparison comparison =
        compare(solution.problem, state, solution.same_step, spec.options.precision, solution.steps,
                spec.options.formulation, admitted_error(solution.problem, spec, solution.steps));
    if (solution.chaos.chaotic() && comparison.finite) comparison.reason.clear();
    return comparison;
}

Errors no_errors(const ReferenceSolution& solution) {
    Errors errors;
    errors.chaotic = solution.chaos.chaotic();
    errors.divergence = solution.chaos.divergence;
    if (!solution.refined.reason.empty()) errors.total_reason = solution.refined.reason;
    return errors;
}

Errors errors_of(const ReferenceSolution& solution, const State& state, const Comparison& comparison) {
    Errors errors = no_errors(solution);
    errors.relative_l2 = comparison.relative_l2;
    errors.max = comparison.max;
    errors.worst_particle = comparison.worst;
    if (!comparison.finite || state.displacement.size() != solution.same_step.displacement.size())
        return errors;
    if (const auto& exact = solution.refined.displacement; !exact.empty()) {
        double largest = 0;
        for (std::size_t i = 0; i < exact.size(); ++i)
            largest = std::max(largest, glm::length(state.displacement[i] - exact[i]));
        errors.total_relative_l2 = relative_difference(state.displacement, exact);
        errors.total_max = largest;
        errors.total_uncertainty = solution.refined.uncertainty;
    }
    const Drift drifted = drift(conserved(solution.problem, state), solution.conserved);
    errors.momentum = drifted.momentum;
    errors.energy = drifted.energy;
    return errors;
}

}  // namespace voxspring
