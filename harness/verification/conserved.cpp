#include "harness/verification/conserved.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "harness/verification/sum.h"

namespace voxspring {
namespace {

double quotient(double difference, double size) {
    if (difference == 0) return 0;
    return size > 0 ? difference / size : std::copysign(std::numeric_limits<double>::infinity(), difference);
}

/// The energy of a spring of stiffness 1. `rest` is the spring at rest as particle i sees it, `relative` is
/// u_i - u_j.
double spring_energy(const RestSpring& rest, const glm::dvec3& relative) {
    const glm::dvec3 offset = rest.offset + relative;
    // |d| - l = (|d|^2 - l^2) / (|d| + l), the numerator as in strain_density().
    const double excess = glm::dot(relative, rest.offset + offset) - rest.deficit;
    const double sum = glm::length(offset) + rest.length;
    const double stretch = sum > 0 ? excess / sum : 0;
    return stretch * stretch / 2;
}

}  // namespace

Momentum& Momentum::operator+=(const Momentum& other) {
    sum += other.sum;
    size += other.size;
    return *this;
}

Energy& Energy::operator+=(const Energy& other) {
    kinetic += other.kinetic;
    springs += other.springs;
    field += other.field;
    field_size += other.field_size;
    return *this;
}

Momentum momentum(const Problem& problem, const State& state) {
    return sum_of<Momentum>(problem.particle_count(), [&](Momentum& part, std::size_t i) {
        if (problem.is_pinned(i)) return;
        const glm::dvec3 p = problem.material_of(i).mass / problem.time_step * state.increment[i];
        part += {p, glm::length(p)};
    });
}

Energy energy(const Problem& problem, const State& state) {
    const double time_step_squared = problem.time_step * problem.time_step;
    Energy result = sum_of<Energy>(problem.particle_count(), [&](Energy& part, std::size_t i) {
        if (problem.is_pinned(i)) return;
        const double mass = problem.material_of(i).mass;
        part.kinetic += mass * glm::dot(state.increment[i], state.increment[i]) / time_step_squared / 2;
        glm::dvec3 force = mass * problem.gravity;
        if (!problem.load.empty()) force += problem.load[i];
        const double work = glm::dot(force, state.displacement[i]);
        part.field -= work;
        part.field_size += std::abs(work);
    });
    std::array<RestSpring, neighbour_count> rest{};
    for (const Direction& direction : directions())
        rest[std::size_t(direction.bit)] = rest_spring(problem, direction);
    const LatticeSprings springs(problem);
    result += sum_of<Energy>(problem.lattice.mask.size(), [&](Energy& part, std::size_t i) {
        springs.of(i, [&](std::uint32_t j, const Direction& direction) {
            part.springs += problem.spring_stiffness(i, j, direction) *
                            spring_energy(rest[std::size_t(direction.bit)],
                                          state.displacement[i] - state.displacement[j]);
        });
    });
    result += sum_of<Energy>(problem.springs.size(), [&](Energy& part, std::size_t s) {
        const Spring& spring = problem.springs[s];
        part.springs += spring.stiffness *
                        spring_energy(rest_spring(problem, spring),
                                      state.displacement[spring.first] - state.displacement[spring.second]);
    });
    return result;
}

Conserved conserved(const Problem& problem, const State& state) {
    return {momentum(problem, state), energy(problem, state)};
}

Drift drift(const Conserved& run, const Conserved& reference) {
    return {quotient(glm::length(run.momentum.sum - reference.momentum.sum), reference.momentum.size),
            quotient(run.energy.total() - reference.energy.total(), reference.energy.size())};
}

}  // namespace voxspring
