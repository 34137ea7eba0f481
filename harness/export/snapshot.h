// What of a run is written to a file.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "harness/scene/scene.h"

namespace voxspring {

/// A run after `step` steps. Quantities are in the scene's units.
struct Snapshot {
    const Scene& scene;
    const Problem& problem;  ///< the scene's as the edits made so far have left it
    const State& state;
    std::int64_t step = 0;
    double time = 0;      ///< step times time step
    std::string backend;  ///< that ran it, as BackendSpec::label() has it
};

/// Rest position plus displacement, one a particle.
std::vector<glm::dvec3> positions(const Snapshot& snapshot);
/// x(t) - x(t - dt) over the time step, one a particle.
std::vector<glm::dvec3> velocities(const Snapshot& snapshot);

}  // namespace voxspring
