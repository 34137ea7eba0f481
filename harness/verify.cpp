#include "harness/verify.h"

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

double rounding_tolerance(const Problem& problem, const State& reference, Precision precision, int steps) {
    double extent = 0;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        extent = std::max(extent, largest_component(problem.rest_position[i] + reference.displacement[i]));
    }
    double rest_length = *std::max_element(problem.rest_length.begin(), problem.rest_length.end());
    for (const Spring& spring : problem.springs) rest_length = std::max(rest_length, spring.rest_length);
    const double unit = precision == Precision::float32 ? std::ldexp(1.0, -24) : std::ldexp(1.0, -53);
    return unit * (extent + 16 * rest_length) * std::pow(steps + 2, 1.5);
}

Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps) {
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

    result.tolerance = rounding_tolerance(problem, reference, precision, steps);
    if (!(result.max <= result.tolerance)) {
        reason << "particle " << result.worst << " is off by " << result.max << ", tolerance "
               << result.tolerance;
        result.reason = reason.str();
    }
    return result;
}

}  // namespace voxspring
