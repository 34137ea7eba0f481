#include "harness/verification/verify.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <sstream>

#include "backends/disk_cache.h"
#include "harness/verification/sum.h"

namespace voxspring {
namespace {

bool finite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

double largest_component(const glm::dvec3& v) {
    return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

/// The largest coordinate, displacement and increment of any particle.
struct Largest {
    double position = 0, displacement = 0, increment = 0;
    Largest& operator+=(const Largest& other) {
        position = std::max(position, other.position);
        displacement = std::max(displacement, other.displacement);
        increment = std::max(increment, other.increment);
        return *this;
    }
};

constexpr std::size_t no_index = std::numeric_limits<std::size_t>::max();

/// Sums over the differences of particles from the reference. `worst` is the first particle with the largest
/// difference, `infinite` the first particle whose displacement is not finite.
struct Apart {
    double squared_error = 0, squared_reference = 0;
    glm::dvec3 error{0};
    double max = 0;
    std::size_t worst = 0, infinite = no_index;
    Apart& operator+=(const Apart& other) {
        squared_error += other.squared_error;
        squared_reference += other.squared_reference;
        error += other.error;
        infinite = std::min(infinite, other.infinite);
        if (other.max > max) {
            max = other.max;
            worst = other.worst;
        }
        return *this;
    }
};

}  // namespace

std::string fingerprint_of(const State& state) {
    Hash hash;
    hash.add_numbers(state.displacement);
    hash.add_numbers(state.increment);
    return hash.text();
}

std::string fingerprint_of(Backend& backend) {
    const std::string own = backend.state_fingerprint();
    return own.empty() ? fingerprint_of(backend.download()) : own;
}

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
    const auto largest = sum_of<Largest>(problem.particle_count(), [&](Largest& part, std::size_t i) {
        part += {largest_component(problem.rest_position[i] + reference.displacement[i]),
                 glm::length(reference.displacement[i]), glm::length(reference.increment[i])};
    });
    const double extent = largest.position;
    const SpringLengths springs = spring_lengths(problem);
    const double rest_length = springs.longest;
    const double n = steps + 2;
    const double moved = largest.displacement + n * largest.increment;
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
    // The errors stay infinite if either state is not finite or if the numbers of particles differ.
    result.relative_l2 = result.max = result.rms = result.mean = infinity;
    const bool fits =
        reference.displacement.empty() || state.displacement.size() == reference.displacement.size();
    const auto apart = sum_of<Apart>(state.displacement.size(), [&](Apart& part, std::size_t i) {
        if (!finite(state.displacement[i])) {
            part.infinite = std::min(part.infinite, i);
        } else if (fits) {
            const glm::dvec3 expected = reference.displacement_of(i);
            const glm::dvec3 off = state.displacement[i] - expected;
            const double error = glm::length(off);
            part += {error * error, glm::dot(expected, expected), off, error, i};
        }
    });
    if (apart.infinite != no_index) {
        result.reason = "particle " + std::to_string(apart.infinite) + " is not finite";
        result.worst = apart.infinite;
        return result;
    }
    result.finite = true;
    if (!fits) {
        result.reason = std::to_string(state.displacement.size()) + " particles instead of " +
                        std::to_string(reference.displacement.size());
        return result;
    }
    // Comparisons with NaN are false: a difference from NaN would be taken for none.
    if (!std::isfinite(apart.squared_reference)) {
        result.reason = "the reference is not finite";
        return result;
    }
    result.max = apart.max;
    result.worst = apart.worst;
    result.relative_l2 = result.rms = result.mean = 0;
    if (const auto particles = double(state.displacement.size()); particles > 0) {
        result.rms = std::sqrt(apart.squared_error / particles);
        result.mean = glm::length(apart.error) / particles;
    }
    if (apart.squared_reference > 0) {
        result.relative_l2 = std::sqrt(apart.squared_error / apart.squared_reference);
    } else if (apart.squared_error > 0) {
        result.relative_l2 = infinity;
    }
    return result;
}

void judge(Comparison& comparison) {
    std::ostringstream reason;
    if (!(comparison.max <= comparison.tolerance)) {
        reason << "particle " << comparison.worst << " is off by " << comparison.max << ", tolerance "
               << comparison.tolerance;
    } else if (!(comparison.rms <= comparison.tolerance_rms)) {
        reason << "particles are off by " << comparison.rms << " in the root mean square, tolerance "
               << comparison.tolerance_rms;
    } else if (!(comparison.mean <= comparison.tolerance_mean)) {
        reason << "the particles' mean displacement is off by " << comparison.mean << ", tolerance "
               << comparison.tolerance_mean;
    }
    comparison.reason = reason.str();
}

Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps, Formulation formulation, double root_error) {
    Comparison result = differences(state, reference);
    if (!result.passed()) return result;
    result.tolerance = rounding_tolerance(problem, reference, precision, steps, formulation, root_error);
    judge(result);
    return result;
}

}  // namespace voxspring
