#include "harness/simulation/picking.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

namespace voxspring {
namespace {

using Pair = std::pair<std::uint32_t, std::uint32_t>;

/// A squared distance and the particle at that distance. Of equally distant particles the one with the
/// smaller index counts as nearer.
using Near = std::pair<double, std::uint32_t>;

double squared(const glm::dvec3& v) { return glm::dot(v, v); }

/// Calls find(i, found) for each i below `count`, on all cores. Returns all elements that `find` appends to
/// `found`, sorted.
template <class Found, class Find>
std::vector<Found> gather(std::size_t count, const Find& find) {
    std::vector<Found> all;
#pragma omp parallel
    {
        std::vector<Found> found;
#pragma omp for schedule(static) nowait
        for (std::size_t i = 0; i < count; ++i) find(i, found);
#pragma omp critical(voxspring_gather)
        all.insert(all.end(), found.begin(), found.end());
    }
    std::sort(all.begin(), all.end());
    return all;
}

}  // namespace

std::uint32_t Places::nearest_to(const glm::dvec3& place) const {
    Near nearest{std::numeric_limits<double>::infinity(), 0};
#pragma omp parallel
    {
        Near own{std::numeric_limits<double>::infinity(), 0};
#pragma omp for schedule(static) nowait
        for (std::size_t i = 0; i < count(); ++i)
            own = std::min(own, Near(squared((*this)[i] - place), std::uint32_t(i)));
#pragma omp critical(voxspring_nearest)
        nearest = std::min(nearest, own);
    }
    return nearest.second;
}

std::vector<std::uint32_t> Places::near(const glm::dvec3& place, double radius, std::size_t most) const {
    std::vector<Near> found = gather<Near>(count(), [&](std::size_t i, std::vector<Near>& out) {
        const double distance = squared((*this)[i] - place);
        if (distance <= radius * radius) out.emplace_back(distance, std::uint32_t(i));
    });
    if (found.empty()) return {nearest_to(place)};
    found.resize(std::min(found.size(), most));
    std::vector<std::uint32_t> particles;
    for (const auto& [distance, particle] : found) particles.push_back(particle);
    std::sort(particles.begin(), particles.end());
    return particles;
}

std::vector<Pair> Places::springs_through(const std::array<glm::dvec3, 4>& quad) const {
    const Shape swept = TrianglePatch{{{quad[0], quad[1], quad[3]}, {quad[0], quad[3], quad[2]}}};
    glm::dvec3 low = quad[0], high = quad[0];
    for (const glm::dvec3& corner : quad) {
        low = glm::min(low, corner);
        high = glm::max(high, corner);
    }
    // The box around the triangles has a margin that is larger than the rounding error of a position.
    const glm::dvec3 reach = glm::max(glm::abs(low), glm::abs(high));
    const double margin = 1e-9 * std::max({reach.x, reach.y, reach.z});
    low -= margin;
    high += margin;

    // One bit per side of the box, set if the particle lies beyond that side. A spring with both ends beyond
    // the same side does not meet the box.
    std::vector<std::uint8_t> outside(count());
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < count(); ++i) {
        const glm::dvec3 place = (*this)[i];
        unsigned sides = 0;
        for (int axis = 0; axis < 3; ++axis) {
            if (place[axis] < low[axis]) sides |= 1U << axis;
            if (place[axis] > high[axis]) sides |= 8U << axis;
        }
        outside[i] = std::uint8_t(sides);
    }
    const auto crosses = [&](std::uint32_t i, std::uint32_t j) {
        return (outside[i] & outside[j]) == 0 && cuts(swept, (*this)[i], (*this)[j]);
    };
    const LatticeSprings lattice(problem_);
    std::vector<Pair> found = gather<Pair>(count(), [&](std::size_t i, std::vector<Pair>& out) {
        lattice.of(i, [&](std::uint32_t j, const Direction&) {
            if (crosses(std::uint32_t(i), j)) out.emplace_back(std::uint32_t(i), j);
        });
    });
    const std::vector<Pair> beyond =
        gather<Pair>(problem_.springs.size(), [&](std::size_t s, std::vector<Pair>& out) {
            const Spring& spring = problem_.springs[s];
            if (crosses(spring.first, spring.second)) out.emplace_back(spring.first, spring.second);
        });
    found.insert(found.end(), beyond.begin(), beyond.end());
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
}

std::vector<ChangedSpring> Places::lost_springs(const Problem& whole, const glm::dvec3& a,
                                                const glm::dvec3& b, double radius) const {
    const glm::dvec3 along = b - a;
    const auto is_near = [&](std::size_t i) {
        const glm::dvec3 from_a = (*this)[i] - a;
        const double part = squared(along) > 0 ? glm::dot(from_a, along) / squared(along) : 0;
        return squared(from_a - std::clamp(part, 0.0, 1.0) * along) <= radius * radius;
    };
    std::vector<Pair> beyond;
    for (const Spring& spring : problem_.springs) beyond.emplace_back(spring.first, spring.second);
    std::sort(beyond.begin(), beyond.end());
    const auto joined = [&](std::uint32_t i, std::uint32_t j) {
        return std::binary_search(beyond.begin(), beyond.end(), Pair(i, j));
    };

    const LatticeSprings lattice(whole);
    const std::vector<std::uint32_t>& mask = problem_.lattice.mask;
    std::vector<std::uint32_t> parted =
        gather<std::uint32_t>(mask.size(), [&](std::size_t i, std::vector<std::uint32_t>& out) {
            if (mask[i] != whole.lattice.mask[i] && is_near(i)) out.push_back(std::uint32_t(i));
        });
    std::vector<ChangedSpring> lost;
    for (const std::uint32_t i : parted) {
        lattice.of(i, [&](std::uint32_t j, const Direction& direction) {
            if ((mask[i] >> direction.bit & 1U) != 0 || !is_near(j) || joined(i, j)) return;
            lost.push_back({{i, j, whole.spring_stiffness(i, j, direction),
                             whole.rest_length[std::size_t(direction.bit)]},
                            direction.bit});
        });
    }
    for (const Spring& spring : whole.springs) {
        if (is_near(spring.first) && is_near(spring.second) && !joined(spring.first, spring.second))
            lost.push_back({spring, -1});
    }
    return lost;
}

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
    const Places place(problem, state);
    std::vector<double> sum(problem.particle_count());
    std::vector<std::uint32_t> springs(problem.particle_count());
    const auto add = [&](std::size_t i, std::size_t j, double rest_length) {
        if (rest_length <= 0) return;
        sum[i] += glm::distance(place[i], place[j]) / rest_length - 1;
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
