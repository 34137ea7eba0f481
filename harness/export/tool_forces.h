// The force on a scene's tool along a run, which `voxspring run --tool-force FILE.csv` writes.
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <optional>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

/// A CSV table: a line that names its columns, then a line after each so many steps and after the last.
///
///     step, time                   of the scene; the force is that of the step that ends there
///     x, y, z                      how far the tool had moved in that step since it took hold (a length)
///     force_x, force_y, force_z    on the tool, see Backend::tool_force() (mass times length per time
///     squared)
///
/// Numbers are the shortest texts that read back as the same bits.
class ToolForces {
public:
    /// `every`: steps between lines; nothing: as many as the tool stays where it is. The run ends after
    /// `steps` steps. Throws BadInput where the path does not end in .csv or takes no file, and where the
    /// scene has no tool. The scene must outlive it.
    ToolForces(std::filesystem::path path, const Scene& scene, std::optional<int> every, int steps);

    /// The next step after `step` after which a line is due.
    int next(int step) const;
    /// Adds the line of step `step`, at least 1, unless that is the last line already.
    void add(int step, const glm::dvec3& force);
    /// Replaces the file in one step. Throws std::system_error.
    void write() const;

    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
    const Scene& scene_;
    int every_;
    int steps_;
    int last_ = 0;  ///< step of the last line
    std::string text_ = "step,time,x,y,z,force_x,force_y,force_z\n";
};

}  // namespace voxspring
