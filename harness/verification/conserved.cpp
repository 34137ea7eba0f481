#include "harness/verification/conserved.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <limits>
#include <vector>

namespace voxspring {
namespace {

double quotient(double difference, double size) {
    if (difference == 0) return 0;
    return size > 0 ? difference / size : std::copysign(std::numeric_limits<double>::infinity(), difference);
}

}  // namespace

namespace {

Momentum& operator+=(Momentum& sum, const Momentum& part) {
    sum.sum += part.sum;
    sum.size += part.size;
    return sum;
}

Energy& operator+=(Energy& sum, const Energy& part) {
    sum.kinetic += part.kinetic;
    sum.springs += part.springs;
    sum.field += part.field;
    sum.field_size += part.field_size;
    return sum;
}

/// The sum of add(part, i) over all i < count, in an order that does not depend on the number of threads.
template <class Sum, class Add>
Sum sum_of(std::size_t count, Add add) {
    constexpr std::size_t chunk = 65536;
    std::vector<Sum> parts((count + chunk - 1) / chunk);
#pragma omp parallel for
    for (std::ptrdiff_t c = 0; c < std::ptrdiff_t(parts.size()); ++c) {
        const std::size_t begin = std::size_t(c) * chunk;
        for (std::size_t i = begin; i < std::min(begin + chunk, count); ++i) add(parts[std::size_t(c)], i);
    }
    Sum sum;
    for (const Sum& part : parts) sum += part;
    return sum;
}

/// Of a spring of stiffness 1. `rest`: as particle i sees it. `relative`: u_i - u_j.
double spring_energy(const RestSpring& rest, const glm::dvec3& relative) {
    const glm::dvec3 offset = rest.offset + relative;
    // |d| - l = (|d|^2 - l^2) / (|d| + l), the numerator as in strain_density().
    const double excess = glm::dot(relative, rest.offset + offset) - rest.deficit;
    const double sum = glm::length(offset) + rest.length;
    const double stretch = sum > 0 ? excess / sum : 0;
    return stretch * stretch / 2;
}

}  // namespace

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
