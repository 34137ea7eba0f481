// What a hand, a blade and a needle meet: particles and springs by the places to which a state has moved
// them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <utility>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/problem.h"

namespace voxspring {

/// A problem's particles where a state, which is finite, has moved them: rest position plus displacement.
/// Refers to both. All functions are on all cores and give the same however many these are.
class Places {
public:
    Places(const Problem& problem, const State& state) : problem_(problem), state_(state) {}

    glm::dvec3 operator[](std::size_t particle) const {
        return problem_.rest_position[particle] + state_.displacement[particle];
    }

    /// The particle nearest to `place`.
    std::uint32_t nearest_to(const glm::dvec3& place) const;
    /// Those within `radius` of `place`, ascending; the nearest where there is none, and the nearest `most`
    /// where there are more.
    std::vector<std::uint32_t> near(const glm::dvec3& place, double radius, std::size_t most) const;

    /// The pairs whose spring goes through one of the triangles (0, 1, 3) and (0, 3, 2) of a quad, their
    /// borders included; ascending, the smaller particle first.
    std::vector<std::pair<std::uint32_t, std::uint32_t>> springs_through(
        const std::array<glm::dvec3, 4>& quad) const;

    /// The springs of `whole`, the same particles with other springs, that join two of them within `radius`
    /// of the line from `a` to `b`, and that the problem has no longer; those of the lattice by their first
    /// particle and direction, then the others in their order.
    std::vector<ChangedSpring> lost_springs(const Problem& whole, const glm::dvec3& a, const glm::dvec3& b,
                                            double radius) const;

private:
    std::size_t count() const { return problem_.particle_count(); }

    const Problem& problem_;
    const State& state_;
};

}  // namespace voxspring
