#include "harness/verification/errors.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

namespace voxspring {

nlohmann::json number_or_null(double value) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

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

nlohmann::json no_error_fields(const ReferenceSolution& solution) {
    nlohmann::json fields = {
        {"chaotic", solution.chaos.chaotic()}, {"divergence", nullptr}, {"total_error_reason", nullptr}};
    for (const char* field : {"error_relative_l2", "error_max", "worst_particle", "total_error_relative_l2",
                              "total_error_max", "total_error_uncertainty", "momentum_error", "energy_error"})
        fields[field] = nullptr;
    if (solution.chaos.divergence) fields["divergence"] = number_or_null(*solution.chaos.divergence);
    if (!solution.refined.reason.empty()) fields["total_error_reason"] = solution.refined.reason;
    return fields;
}

nlohmann::json error_fields(const ReferenceSolution& solution, const State& state,
                            const Comparison& comparison) {
    nlohmann::json fields = no_error_fields(solution);
    fields["error_relative_l2"] = number_or_null(comparison.relative_l2);
    fields["error_max"] = number_or_null(comparison.max);
    fields["worst_particle"] = comparison.worst;
    if (!comparison.finite || state.displacement.size() != solution.same_step.displacement.size())
        return fields;
    if (const auto& exact = solution.refined.displacement; !exact.empty()) {
        double largest = 0;
        for (std::size_t i = 0; i < exact.size(); ++i)
            largest = std::max(largest, glm::length(state.displacement[i] - exact[i]));
        fields["total_error_relative_l2"] = number_or_null(relative_difference(state.displacement, exact));
        fields["total_error_max"] = largest;
        fields["total_error_uncertainty"] = solution.refined.uncertainty;
    }
    const Drift drifted = drift(conserved(solution.problem, state), solution.conserved);
    fields["momentum_error"] = number_or_null(drifted.momentum);
    fields["energy_error"] = number_or_null(drifted.energy);
    return fields;
}

}  // namespace voxspring
