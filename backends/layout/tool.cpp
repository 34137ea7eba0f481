#include "backends/layout/tool.h"

#include "backends/layout/vectors.h"

namespace voxspring::layout {

template <class Real>
std::vector<HeldWord<Real>> pack_held(const Problem& problem, const Placement& placement,
                                      Formulation formulation) {
    std::vector<HeldWord<Real>> held;
    held.reserve(problem.tool.particles.size());
    for (std::size_t n = 0; n < problem.tool.particles.size(); ++n) {
        const std::uint32_t i = problem.tool.particles[n];
        glm::dvec3 anchor = problem.tool.held_at(n);
        if (on_positions(formulation)) anchor += problem.rest_position[i];
        held.push_back(
            {vector_of<Real>(anchor), std::uint32_t(placement.at(i)), vector_of<Real>(problem.load[i])});
    }
    return held;
}

template <class Real>
glm::dvec3 force_on_tool(const std::vector<HeldForce<Real>>& forces) {
    glm::dvec3 sum(0);
    for (const HeldForce<Real>& force : forces) sum -= dvec_of(force.force);
    return sum;
}

template std::vector<HeldWord<float>> pack_held(const Problem&, const Placement&, Formulation);
template std::vector<HeldWord<double>> pack_held(const Problem&, const Placement&, Formulation);
template glm::dvec3 force_on_tool(const std::vector<HeldForce<float>>&);
template glm::dvec3 force_on_tool(const std::vector<HeldForce<double>>&);

}  // namespace voxspring::layout
