#include "harness/export/snapshot.h"

#include "backends/cpu/perturbed_reference.h"

namespace voxspring {

const Placement* placement_of(const Snapshot& snapshot) {
    const auto& volume = snapshot.scene.volume;
    return volume && volume->placement ? &*volume->placement : nullptr;
}

std::vector<glm::dvec3> positions(const Snapshot& snapshot) {
    std::vector<glm::dvec3> position = snapshot.problem.rest_position;
    for (std::size_t i = 0; i < position.size(); ++i) position[i] += snapshot.state.displacement[i];
    return position;
}

std::vector<glm::dvec3> velocities(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const auto backend = make_perturbed_reference({});  // float64, without perturbation
    backend->upload(problem, snapshot.state);
    if (problem.has_tool())
        backend->tool()->move_tool(snapshot.scene.tool_motion.at_step(snapshot.step, problem.time_step));
    backend->step(1);
    std::vector<glm::dvec3> velocity = backend->download().increment;  // x(t + dt) - x(t)
    for (std::size_t i = 0; i < velocity.size(); ++i)
        velocity[i] = (snapshot.state.increment_of(i) + velocity[i]) / (2 * problem.time_step);
    return velocity;
}

}  // namespace voxspring
