// Finds the particles and springs that a user's hand, blade or needle meets, at the places to which a state
// has moved the particles. Also measures how much the springs are stretched.
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

/// The places of a problem's particles in a state: rest position plus displacement. The state must be finite.
/// This object keeps references to the problem and the state. The searches run on all cores, and their
/// results do not depend on the number of cores.
class Places {
public:
    Places(const Problem& problem, const State& state) : problem_(problem), state_(state) {}

    glm::dvec3 operator[](std::size_t particle) const {
        return problem_.rest_position[particle] + state_.displacement[particle];
    }

    /// The particle nearest to `place`.
    std::uint32_t nearest_to(const glm::dvec3& place) const;
    /// The particles within `radius` of `place`, ascending. If there is none, the result is the nearest
    /// particle; if there are more than `most`, the nearest `most`.
    std::vector<std::uint32_t> near(const glm::dvec3& place, double radius, std::size_t most) const;

    /// The pairs of particles whose spring passes through one of the triangles (0, 1, 3) and (0, 3, 2) of a
    /// quad, edges of the triangles included. Pairs are ascending, and have the smaller particle first.
    std::vector<std::pair<std::uint32_t, std::uint32_t>> springs_through(
        const std::array<glm::dvec3, 4>& quad) const;

    /// The springs of `whole` whose two particles are not joined in this problem and lie within `radius` of
    /// the line from `a` to `b`. `whole` has the same particles with other springs. Lattice springs come
    /// first, sorted by first particle and direction, then the springs of `whole.springs` in their order.
    std::vector<ChangedSpring> lost_springs(const Problem& whole, const glm::dvec3& a, const glm::dvec3& b,
                                            double radius) const;

private:
    std::size_t count() const { return problem_.particle_count(); }

    const Problem& problem_;
    const State& state_;
};

/// Whether every number of the state is finite.
bool finite(const State& state);

/// For each particle the mean of |x_i - x_j| / l_ij - 1 over its springs: how much they are stretched, as a
/// share of the rest length; negative if they are shortened. The value of a particle without springs is 0.
/// Springs of rest length 0 are left out. Lattice springs are computed on all cores.
std::vector<double> tensions(const Problem& problem, const State& state);

}  // namespace voxspring
