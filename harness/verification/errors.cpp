#include "harness/verification/errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <limits>

#include "harness/verification/error_threshold.h"
#include "harness/verification/sum.h"

namespace voxspring {

namespace {

/// How far a particle may fall behind in `steps` steps, in units of length, because the options of `spec`
/// allow it (a sleep threshold).
double admitted_error(const Problem& problem, const BackendSpec& spec, int steps) {
    const glm::dvec3 spacing = problem.lattice.spacing;
    return steps * spec.admitted_spacings_per_step() * std::min({spacing.x, spacing.y, spacing.z});
}

void judge_statistics(Comparison& comparison, const Spread& spread, const Statistics& found) {
    for (std::size_t kind = 0; kind < found.size(); ++kind) {
        const double bound = statistic_gate(spread.statistic[kind], found[kind].size);
        if (found[kind].difference <= bound) continue;
        comparison.reason =
            fmt::format("the scene is chaotic, and the {} of the state is off by {:g}, tolerance {:g}",
                        to_string(Statistic::Kind(kind)), found[kind].difference, bound);
        return;
    }
}

const Conserved& conserved_of(const ReferenceSolution& solution) {
    if (!solution.conserved) solution.conserved = conserved(solution.problem, solution.same_step);
    return *solution.conserved;
}

}  // namespace

const Spread* spread_of(const ReferenceSolution& solution, const RoundingModel& model) {
    for (const auto& [known, spread] : solution.spreads) {
        if (known == model) return &spread;
    }
    return nullptr;
}

JudgedState judge(const ReferenceSolution& solution, const State& state, const BackendSpec& spec) {
    JudgedState comparison{differences(state, solution.same_step), {}};
    comparison.tolerance = std::numeric_limits<double>::infinity();
    const Spread* const spread = spread_of(solution, rounding_model_of(spec));
    if (!comparison.passed() || spread == nullptr) return comparison;
    if (is_chaotic(*spread)) {
        if (!solution.summary)
            solution.summary = summary_of(solution.problem, solution.start, solution.same_step,
                                          conserved_of(solution).energy);
        const StateSummary summary = summary_of(solution.problem, solution.start, state);
        comparison.energy = summary.energy;
        judge_statistics(comparison, *spread, statistics(summary, *solution.summary));
    } else {
        const double admitted = admitted_error(solution.problem, spec, solution.steps);
        comparison.tolerance = gate(spread->max, spread->motion_max, admitted);
        comparison.tolerance_rms = gate(spread->rms, spread->motion_rms, admitted);
        comparison.tolerance_mean = mean_gate(spread->mean, spread->motion_mean, admitted);
        judge(comparison);
    }
    return comparison;
}

double strained_share(const ReferenceSolution& solution, const BackendSpec& spec) {
    const Problem& problem = solution.problem;
    const State& state = solution.same_step;
    const Spread* const spread = spread_of(solution, rounding_model_of(spec));
    if (spread == nullptr || is_chaotic(*spread)) return 0;
    const double admitted = admitted_error(problem, spec, solution.steps);
    // If rounding carries single particles too far, the bound on the largest error is infinite, and the bound
    // on the root mean square counts.
    const double bound = std::min(gate(spread->max, spread->motion_max, admitted),
                                  gate(spread->rms, spread->motion_rms, admitted));
    if (const auto known = solution.strained_shares.find(bound); known != solution.strained_shares.end())
        return known->second;
    const auto is_strained = [&](const RestSpring& rest, std::size_t i, std::size_t j) {
        const glm::dvec3 offset = rest.offset + state.displacement_of(i) - state.displacement_of(j);
        return std::abs(glm::length(offset) - rest.length) > bound;
    };
    std::array<RestSpring, neighbour_count> rest_springs;
    for (const Direction& direction : directions())
        rest_springs[std::size_t(direction.bit)] = rest_spring(problem, direction);
    const LatticeSprings springs(problem);
    auto strained = sum_of<std::uint64_t>(problem.particle_count(), [&](std::uint64_t& part, std::size_t i) {
        springs.of(i, [&](std::uint32_t j, const Direction& direction) {
            part += is_strained(rest_springs[std::size_t(direction.bit)], i, j) ? 1 : 0;
        });
    });
    for (const Spring& spring : problem.springs)
        strained += is_strained(rest_spring(problem, spring), spring.first, spring.second) ? 1 : 0;
    const std::uint64_t all = count_springs(problem).total();
    return solution.strained_shares[bound] = all == 0 ? 1 : double(strained) / double(all);
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

Errors errors_of(const ReferenceSolution& solution, const State& state, const JudgedState& judged,
                 const BackendSpec& spec) {
    Errors errors = no_errors(solution, spec);
    errors.relative_l2 = judged.relative_l2;
    errors.max = judged.max;
    errors.worst_particle = judged.worst;
    if (!judged.finite || state.displacement.size() != solution.same_step.displacement.size()) return errors;
    if (const auto& exact = solution.refined.displacement; !exact.empty()) {
        double largest = 0;
        for (std::size_t i = 0; i < exact.size(); ++i)
            largest = std::max(largest, glm::length(state.displacement[i] - exact[i]));
        errors.total_relative_l2 = relative_difference(state.displacement, exact);
        errors.total_max = largest;
        errors.total_uncertainty = solution.refined.uncertainty;
    }
    const Energy reached = judged.energy ? *judged.energy : energy(solution.problem, state);
    const Drift drifted = drift({momentum(solution.problem, state), reached}, conserved_of(solution));
    errors.momentum = drifted.momentum;
    errors.energy = drifted.energy;
    return errors;
}

}  // namespace voxspring
