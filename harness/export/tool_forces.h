// Records the force on a scene's tool during a run, for `voxspring run --tool-force FILE.csv`.
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <optional>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

/// A CSV table: a line that names the columns, then a line after every `every` steps and after the last step.
///
///     step, time                   step and time of the scene; the force is that of the step that ends then
///     x, y, z                      how far the tool had moved in that step since it took hold (a length)
///     force_x, force_y, force_z    force on the tool, see Backend::tool_force() (mass times length per
///                                  time squared)
///
/// Numbers are the shortest texts that read back as the same bits.
class ToolForces {
public:
    /// `every` is the number of steps between lines; absent: the steps between two moves of the tool. The run
    /// ends after `steps` steps. Throws BadInput if the path does not end in .csv or is not writable, or if
    /// the scene has no tool. The scene must outlive this.
    ToolForces(std::filesystem::path path, const Scene& scene, std::optional<int> every, int steps);

    /// The number of steps, larger than `step`, after which the next line is due.
    int next(int step) const;
    /// Adds the line for step `step`, which is at least 1, unless it is already the last line.
    void add(int step, const glm::dvec3& force);
    /// Replaces the file atomically. Throws std::system_error.
    void write() const;

    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
    const Scene& scene_;
    int every_;
    int steps_;
    int last_ = 0;  ///< the step of the last line
    std::string text_ = "step,time,x,y,z,force_x,force_y,force_z\n";
};

}  // namespace voxspring
