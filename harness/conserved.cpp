#include "harness/conserved.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

namespace voxspring {
namespace {

double quotient(double difference, double size) {
    if (difference == 0) return 0;
    return size > 0 ? difference / size : std::copysign(std::numeric_limits<double>::infinity(), difference);
}

}  // namespace

Momentum momentum(const Problem& problem, const State& state) {
    Momentum result;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (problem.is_pinned(i)) continue;
        const glm::dvec3 p = problem.material_of(i).mass / problem.time_step * state.increment[i];
        result.sum += p;
        result.size += glm::length(p);
    }
    return result;
}

Energy energy(const Problem& problem, const State& state) {
    Energy result;
    const double time_step_squared = problem.time_step * problem.time_step;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (problem.is_pinned(i)) continue;
        const double mass = problem.material_of(i).mass;
        result.kinetic += mass * glm::dot(state.increment[i], state.increment[i]) / time_step_squared / 2;
        glm::dvec3 force = mass * problem.gravity;
        if (!problem.load.empty()) force += problem.load[i];
        const double work = glm::dot(force, state.displacement[i]);
        result.field -= work;
        result.field_size += std::abs(work);
    }
    for (const Spring& spring : list_springs(problem)) {
        const RestSpring rest = rest_spring(problem, spring);
        const glm::dvec3 relative = state.displacement[spring.first] - state.displacement[spring.second];
        const glm::dvec3 offset = rest.offset + relative;
        // |d| - l = (|d|^2 - l^2) / (|d| + l), the numerator as in strain_density().
        const double excess = glm::dot(relative, rest.offset + offset) - rest.deficit;
        const double sum = glm::length(offset) + rest.length;
        const double stretch = sum > 0 ? excess / sum : 0;
        result.springs += spring.stiffness * stretch * stretch / 2;
    }
    return result;
}

Drift drift(const Problem& problem, const State& state, const State& reference) {
    const Momentum p = momentum(problem, state), p_reference = momentum(problem, reference);
    const Energy e = energy(problem, state), e_reference = energy(problem, reference);
    return {quotient(glm::length(p.sum - p_reference.sum), p_reference.size),
            quotient(e.total() - e_reference.total(), e_reference.size())};
}

}  // namespace voxspring
