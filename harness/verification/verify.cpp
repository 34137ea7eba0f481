#include "harness/verification/verify.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <sstream>

#include "harness/verification/sum.h"

namespace voxspring {
namespace {

bool finite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

double largest_component(const glm::dvec3& v) {
    return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

/// The smallest index of a particle that is not finite.
struct FirstInfinite {
    std::size_t particle = std::numeric_limits<std::size_t>::max();
    FirstInfinite& operator+=(const FirstInfinite& other) {
        particle = std::min(particle, other.particle);
        return *this;
    }
};

/// Differences of particles from the reference, and the first particle with the largest one.
struct Apart {
    double squared_error = 0, squared_reference = 0;
    double max = 0;
    std::size_t worst = 0;
    Apart& operator+=(const Apart& other) {
        squared_error += other.squared_error;
        squared_reference += other.squared_reference;
        if (other.max > max) {
            max = other.max;
            worst = other.worst;
        }
        return *this;
    }
};

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
                          Formulation formulation, double root_error) {
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
    const double by_roots = root_error * (by_increments(formulation) ? apart : rest_length) * n;
    switch (formulation) {
        case Formulation::paper: {
            const double bias = problem.damping == 0 ? 0 : 1.5 * unit;
            return walked(3 * extent + 16 * rest_length) + bias * extent * n * n / 2 + biased(extent) +
                   by_roots;
        }
        case Formulation::position:
            return walked(on_positions) + biased(extent) + by_roots;
        case Formulation::displacement:
            return walked(moved + 16 * rest_length) + biased(moved) + by_roots;
        case Formulation::increment:
            return walked(moved + 16 * apart) + by_roots;
        case Formulation::compensated:
            return walked(16 * apart) + by_roots;
    }
    return 0;
}

Comparison differences(const State& state, const State& reference) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Comparison result;
    // Replaced once every component has been compared.
    result.relative_l2 = result.max = result.rms = infinity;
    std::ostringstream reason;
    const auto infinite = sum_of<FirstInfinite>(state.displacement.size(), [&](auto& part, std::size_t i) {
        if (!finite(state.displacement[i])) part.particle = std::min(part.particle, i);
    });
    if (infinite.particle != FirstInfinite{}.particle) {
        reason << "particle " << infinite.particle << " is not finite";
        result.worst = infinite.particle;
        result.reason = reason.str();
        return result;
    }
    result.finite = true;
    if (!reference.displacement.empty() && state.displacement.size() != reference.displacement.size()) {
        reason << state.displacement.size() << " particles instead of " << reference.displacement.size();
        result.reason = reason.str();
        return result;
    }

    const auto apart = sum_of<Apart>(state.displacement.size(), [&](Apart& part, std::size_t i) {
        const glm::dvec3 expected = reference.displacement_of(i);
        const double error = glm::length(state.displacement[i] - expected);
        part += {error * error, glm::dot(expected, expected), error, i};
    });
    result.max = apart.max;
    result.worst = apart.worst;
    result.relative_l2 = 0;
    if (!state.displacement.empty())
        result.rms = std::sqrt(apart.squared_error / double(state.displacement.size()));
    if (apart.squared_reference > 0) {
        result.relative_l2 = std::sqrt(apart.squared_error / apart.squared_reference);
    } else if (apart.squared_error > 0) {
        result.relative_l2 = infinity;
    }
    return result;
}

Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps, Formulation formulation, double root_error) {
    Comparison result = differences(state, reference);
    if (!result.passed()) return result;
    result.tolerance = rounding_tolerance(problem, reference, precision, steps, formulation, root_error);
    if (!(result.max <= result.tolerance)) {
        std::ostringstream reason;
        reason << "particle " << result.worst << " is off by " << result.max << ", tolerance "
               << result.tolerance;
        result.reason = reason.str();
    }
    return result;
}

}  // namespace voxspring
