#include "harness/export/snapshot.h"

namespace voxspring {

std::vector<glm::dvec3> positions(const Snapshot& snapshot) {
    std::vector<glm::dvec3> position = snapshot.problem.rest_position;
    for (std::size_t i = 0; i < position.size(); ++i) position[i] += snapshot.state.displacement[i];
    return position;
}

std::vector<glm::dvec3> velocities(const Snapshot& snapshot) {
    std::vector<glm::dvec3> velocity = snapshot.state.increment;
    for (glm::dvec3& v : velocity) v /= snapshot.problem.time_step;
    return velocity;
}

}  // namespace voxspring
