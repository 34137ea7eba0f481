#include "harness/verification/errors.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <sstream>

#include "harness/verification/error_threshold.h"

namespace voxspring {

namespace {

/// The error that the options of `spec` ask for, in units of length.
double admitted_error(const Problem& problem, const BackendSpec& spec, int steps) {
    const glm::dvec3 spacing = problem.lattice.spacing;
    return steps * spec.admitted_spacings_per_step() * std::min({spacing.x, spacing.y, spacing.z});
}

void judge_displacements(Comparison& comparison, const Spread& spread, double admitted) {
    comparison.tolerance = gate(spread.max, spread.motion_max, admitted);
    comparison.tolerance_rms = gate(spread.rms, spread.motion_rms, admitted);
    std::ostringstream reason;
    if (!(comparison.max <= comparison.tolerance)) {
        reason << "particle " << comparison.worst << " is off by " << comparison.max << ", tolerance "
               << comparison.tolerance;
    } else if (!(comparison.rms <= comparison.tolerance_rms)) {
        reason << "particles are off by " << comparison.rms << " in the root mean square, tolerance "
               << comparison.tolerance_rms;
    }
    comparison.reason = reason.str();
}

void judge_statistics(Comparison& comparison, const Spread& spread, const Statistics& found) {
    std::ostringstream reason;
    for (std::size_t kind = 0; kind < found.size(); ++kind) {
        const double bound = statistic_gate(spread.statistic[kind], found[kind].size);
        if (found[kind].difference <= bound) continue;
        reason << "chaotic, and its " << to_string(Statistic::Kind(kind)) << " is off by "
               << found[kind].difference << ", tolerance " << bound;
        break;
    }
    comparison.reason = reason.str();
}

}  // namespace

const Spread* spread_of(const ReferenceSolution& solution, const RoundingModel& model) {
    for (const auto& [known, spread] : solution.spreads) {
        if (known == model) return &spread;
    }
    return nullptr;
}

Comparison judge(const ReferenceSolution& solution, const State& state, const BackendSpec& spec) {
    Comparison comparison = differences(state, solution.same_step);
    comparison.tolerance = std::numeric_limits<double>::infinity();
    const Spread* const spread = spread_of(solution, rounding_model_of(spec));
    if (!comparison.passed() || spread == nullptr) return comparison;
    if (is_chaotic(*spread)) {
        if (!solution.summary)
            solution.summary = summary_of(solution.problem, solution.start, solution.same_step);
        judge_statistics(comparison, *spread,
                         statistics(summary_of(solution.problem, solution.start, state), *solution.summary));
    } else {
        judge_displacements(comparison, *spread, admitted_error(solution.problem, spec, solution.steps));
    }
    return comparison;
}

Errors no_errors(const ReferenceSolution& solution, const BackendSpec& spec) {
    Errors errors;
    if (const Spread* const spread = spread_of(solution, rounding_model_of(spec))) {
        errors.chaotic = is_chaotic(*spread);
        if (spread->motion_rms > 0) errors.spread = spread->rms / spread->motion_rms;
    }
    if (!solution.refined.reason.empty()) errors.total_reason = solution.refined.reason;
    return errors;
}

Errors errors_of(const ReferenceSolution& solution, const State& state, const Comparison& comparison,
                 const BackendSpec& spec) {
    Errors errors = no_errors(solution, spec);
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
