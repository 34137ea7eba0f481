#include "harness/verification/verify.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <sstream>

namespace voxspring {
namespace {

bool finite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

double largest_component(const glm::dvec3& v) {
    return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

}  // namespace

SpringLengths spring_lengths(const Problem& problem) {
    SpringLengths lengths;
    const auto add = [&](const RestSpring& spring) {
        lengths.longest = std::max(lengths.longest, spring.length);
        lengths.strain = std::max(lengths.strain, std::abs(spring.length - glm::length(spring.offset)));
    };
    for (const Direction& direction : directions()) {
        if ((problem.group_bits >> direction.bit & 1u) != 0) add(rest_spring(problem, direction));
    }
    for (const Spring& spring : problem.springs) add(rest_spring(problem, spring));
    return lengths;
}

double forced_acceleration(const Problem& problem) {
    double largest = 0;
    for (std::size_t i = 0; i < problem.load.size(); ++i)
        largest = std::max(largest, glm::length(problem.load[i]) / problem.material_of(i).mass);
    return largest + glm::length(problem.gravity);
}

double rounding_tolerance(const Problem& problem, const State& reference, Precision precision, int steps,
                          Formulation formulation) {
    double extent = 0, moved = 0, increment = 0;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        extent = std::max(extent, largest_component(problem.rest_position[i] + reference.displacement[i]));
        moved = std::max(moved, glm::length(reference.displacement[i]));
        increment = std::max(increment, glm::length(reference.increment[i]));
    }
    const SpringLengths springs = spring_lengths(problem);
    const double rest_length = springs.longest;
    const double n = steps + 2;
    moved += n * increment;
    const double apart = std::min(2 * moved + springs.strain, 2 * rest_length);
    const double on_positions = extent + 16 * rest_length;

    constexpr double double_unit = 0x1p-53;
    const double unit = precision == Precision::float32 ? 0x1p-24 : double_unit;
    const auto walked = [&](double rounded) {
        return std::max(unit * rounded, double_unit * on_positions) * std::pow(n, 1.5);
    };
    const double added = forced_acceleration(problem) * problem.time_step * problem.time_step;
    const auto biased = [&](double state) {
        const double half_ulp = state > 0 ? unit * std::exp2(std::floor(std::log2(state))) : 0;
        return std::min(std::min(half_ulp, added) * n * n / 2, moved);
    };
    switch (formulation) {
        case Formulation::paper: {
            const double bias = problem.damping == 0 ? 0 : 1.5 * unit;
            return walked(3 * extent + 16 * rest_length) + bias * extent * n * n / 2 + biased(extent);
        }
        case Formulation::position:
            return walked(on_positions) + biased(extent);
        case Formulation::displacement:
            return walked(moved + 16 * rest_length) + biased(moved);
        case Formulation::increment:
            return walked(moved + 16 * apart);
        case Formulation::compensated:
            return walked(16 * apart);
    }
    return 0;
}

Comparison differences(const State& state, const State& reference) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Comparison result;
    result.relative_l2 = result.max = result.rms = infinity;  // until every component has been compared
    std::ostringstream reason;
    for (std::size_t i = 0; i < state.displacement.size(); ++i) {
        if (!finite(state.displacement[i])) {
            reason << "particle " << i << " is not finite";
            result.worst = i;
            result.reason = reason.str();
            return result;
        }
    }
    result.finite = true;
    if (state.displacement.size() != reference.displacement.size()) {
        reason << state.displacement.size() << " particles instead of " << reference.displacement.size();
        result.reason = reason.str();
        return result;
    }

    result.relative_l2 = result.max = 0;
    double squared_error = 0;
    double squared_reference = 0;
    for (std::size_t i = 0; i < state.displacement.size(); ++i) {
        const glm::dvec3 difference = state.displacement[i] - reference.displacement[i];
        const double error = glm::length(difference);
        squared_error += error * error;
        squared_reference += glm::dot(reference.displacement[i], reference.displacement[i]);
        if (error > result.max) {
            result.max = error;
            result.worst = i;
        }
    }
    if (!state.displacement.empty())
        result.rms = std::sqrt(squared_error / double(state.displacement.size()));
    if (squared_reference > 0) {
        result.relative_l2 = std::sqrt(squared_error / squared_reference);
    } else if (squared_error > 0) {
        result.relative_l2 = infinity;
    }

    return result;
}

Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps, Formulation formulation) {
    Comparison result = differences(state, reference);
    if (!result.passed()) return result;
    result.tolerance = rounding_tolerance(problem, reference, precision, steps, formulation);
    if (!(result.max <= result.tolerance)) {
        std::ostringstream reason;
        reason << "particle " << result.worst << " is off by " << result.max << ", tolerance "
               << result.tolerance;
        result.reason = reason.str();
    }
    return result;
}

}  // namespace voxspring
