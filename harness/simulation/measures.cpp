#include "harness/simulation/measures.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/geometric.hpp>

namespace voxspring {

bool finite(const State& state) {
    // Zero times a number that is not finite is NaN, and NaN survives every sum.
    double zero = 0;
    for (const auto* vectors : {&state.displacement, &state.increment}) {
#pragma omp parallel for schedule(static) reduction(+ : zero)
        for (const glm::dvec3& v : *vectors) zero += 0 * v.x + 0 * v.y + 0 * v.z;
    }
    return !std::isnan(zero);
}

std::vector<double> tensions(const Problem& problem, const State& state) {
    const auto place = [&](std::size_t i) { return problem.rest_position[i] + state.displacement[i]; };
    std::vector<double> sum(problem.particle_count());
    std::vector<std::uint32_t> springs(problem.particle_count());
    const auto add = [&](std::size_t i, std::size_t j, double rest_length) {
        if (rest_length <= 0) return;
        sum[i] += glm::distance(place(i), place(j)) / rest_length - 1;
        ++springs[i];
    };
    const LatticeSprings lattice(problem);
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < problem.lattice.mask.size(); ++i) {
        lattice.all_of(i, [&](std::uint32_t j, const Direction& direction) {
            add(i, j, problem.rest_length[std::size_t(direction.bit)]);
        });
    }
    for (const Spring& spring : problem.springs) {
        add(spring.first, spring.second, spring.rest_length);
        add(spring.second, spring.first, spring.rest_length);
    }
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < sum.size(); ++i) {
        if (springs[i] > 0) sum[i] /= springs[i];
    }
    return sum;
}

}  // namespace voxspring
