#include "backends/layout/springs.h"

#include <cmath>
#include <glm/geometric.hpp>

#include "backends/layout/vectors.h"
#include "backends/physics/inverse_root.h"

namespace voxspring::layout {

namespace {

// SpringRest has the offset from the particle to the neighbour, RestSpring the opposite offset.
template <class Real>
SpringRest<Real> packed_rest(const RestSpring& rest) {
    return {vector_of<Real>(-rest.offset), Real(rest.deficit)};
}

}  // namespace

std::uint32_t entry_of(std::uint32_t index, int bit, Formulation formulation) {
    if (on_positions(formulation)) return index;
    return index | (bit < 0 ? OWN_DIRECTION : std::uint32_t(bit)) << LISTED_INDEX_BITS;
}

double squared_rest_length(const Problem& problem, const Direction& direction) {
    const glm::dvec3 offset = glm::dvec3(direction.offset) * problem.lattice.spacing;
    const double rest_length = problem.rest_length[std::size_t(direction.bit)];
    const double squared = glm::dot(offset, offset);
    return rest_length == std::sqrt(squared) ? squared : rest_length * rest_length;
}

template <class Real>
Real listed_length(const Problem& problem, const Direction& direction, Formulation formulation) {
    const RestSpring rest = rest_spring(problem, direction);
    if (by_increments(formulation)) return Real(rest.length);
    if (on_positions(formulation) || rest.deficit != 0) return Real(squared_rest_length(problem, direction));
    const Vector<Real> offset = vector_of<Real>(rest.offset);
    return squared_length(offset.x, offset.y, offset.z, Real(problem.shortest_squared()));
}

template <class Real>
Real listed_length(const Spring& spring, Formulation formulation) {
    return Real(by_increments(formulation) ? spring.rest_length : spring.rest_length * spring.rest_length);
}

template <class Real>
SpringRest<Real> off_lattice_rest_of(const Problem& problem, std::uint32_t particle, std::uint32_t neighbour,
                                     double rest_length) {
    return packed_rest<Real>(rest_spring(problem, Spring{particle, neighbour, 0, rest_length}));
}

template <class Real>
std::array<SpringRest<Real>, direction_codes> rest_by_code(const Problem& problem) {
    std::array<SpringRest<Real>, direction_codes> rest{};
    if (problem.lattice.voxel_count() == 0) return rest;
    for (const Direction& direction : directions())
        rest[std::size_t(direction.bit)] = packed_rest<Real>(rest_spring(problem, direction));
    return rest;
}

std::vector<std::uint32_t> degrees(const Problem& problem) {
    std::vector<std::uint32_t> degree(problem.particle_count());
    for (std::size_t i = 0; i < degree.size(); ++i)
        degree[i] = std::uint32_t(std::popcount(mask_of(problem, i) & NEIGHBOUR_BITS));
    for (const Spring& spring : problem.springs) {
        ++degree[spring.first];
        ++degree[spring.second];
    }
    return degree;
}

std::string list_entry_refusal(std::size_t particles, Formulation formulation) {
    if (on_positions(formulation) || particles <= max_listed_particles) return {};
    return std::to_string(particles) + " particles exceed the " + std::to_string(max_listed_particles) +
           " that an entry of a neighbour list can number beside a direction";
}

std::string grouped_list_refusal(const Problem& problem) {
    if (problem.lattice.voxel_count() == 0) return "the network lies on no regular grid";
    if (!problem.springs.empty()) return "some springs are not those of the lattice";
    if (problem.has_materials())
        return "several materials give springs of the same group different stiffnesses";
    for (const Direction& a : directions()) {
        for (const Direction& b : directions()) {
            const bool used = (problem.group_bits >> a.bit & problem.group_bits >> b.bit & 1U) != 0;
            if (used && a.group == b.group &&
                squared_rest_length(problem, a) != squared_rest_length(problem, b))
                return "the springs of a group have several rest lengths";
        }
    }
    return {};
}

#define FOR_PRECISION(Real)                                                                              \
    template Real listed_length(const Problem&, const Direction&, Formulation);                          \
    template Real listed_length(const Spring&, Formulation);                                             \
    template SpringRest<Real> off_lattice_rest_of(const Problem&, std::uint32_t, std::uint32_t, double); \
    template std::array<SpringRest<Real>, direction_codes> rest_by_code(const Problem&);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
