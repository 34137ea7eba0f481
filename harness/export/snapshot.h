// The state of a run as writers of files get it.
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
    const Problem& problem;  ///< the scene's problem as the edits so far have left it
    const State& state;
    std::int64_t step = 0;
    double time = 0;      ///< step times time step
    std::string backend;  ///< label of the backend that ran it, see BackendSpec::label()
};

/// The placement of the grid in the coordinates of the volume's file, or null if the file has none.
const Placement* placement_of(const Snapshot& snapshot);

/// Rest position plus displacement, one element per particle.
std::vector<glm::dvec3> positions(const Snapshot& snapshot);
/// The velocity at the snapshot's time, (x(t + dt) - x(t - dt)) / (2 dt), one element per particle. x(t + dt)
/// comes from one more step in float64, with the snapshot's springs and the scene's tool where it is in that
/// step.
std::vector<glm::dvec3> velocities(const Snapshot& snapshot);

}  // namespace voxspring
