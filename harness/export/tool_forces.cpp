#include "harness/export/tool_forces.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/files.h"

namespace voxspring {

ToolForces::ToolForces(std::filesystem::path path, const Scene& scene, std::optional<int> every, int steps)
    : path_(std::move(path)), scene_(scene), every_(every.value_or(scene.tool_motion.every)), steps_(steps) {
    check_writable(path_, "--tool-force", ".csv");
    if (!scene.problem.has_tool())
        throw BadInput("command line", "--tool-force", path_.string(),
                       "a scene with a tool beside it: " + scene.name + " has none");
}

int ToolForces::next(int step) const {
    return every_ <= steps_ - step ? std::min(steps_, step + every_ - step % every_) : steps_;
}

void ToolForces::add(int step, const glm::dvec3& force) {
    if (step == last_) return;
    last_ = step;
    const double time_step = scene_.problem.time_step;
    const glm::dvec3 at = scene_.tool_motion.at_step(step - 1, time_step);
    text_ += fmt::format("{},{},{},{},{},{},{},{}\n", step, step * time_step, at.x, at.y, at.z, force.x,
                         force.y, force.z);
}

void ToolForces::write() const { write_atomically(path_, text_); }

}  // namespace voxspring
