// How a hand moved a tool: a recording in a file, and where the tool is at any time.
//
// The file is CSV: a first line "time,x,y,z", then a line for each sample. Any unit will do, see ToolMotion;
// only how far the tool has moved since the first sample counts. Between samples it moves in a straight line,
// before the first and after the last it rests.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

struct ToolMotion {
    int every = 1;             ///< steps for which the tool stays where it is
    std::vector<double> time;  ///< of each sample, ascending from 0, in the scene's unit
    /// How far it has moved by then since it took hold, in the scene's unit of length.
    std::vector<glm::dvec3> displacement;

    bool empty() const { return time.empty(); }
    /// Zero where there is no sample.
    glm::dvec3 at(double when) const;
    /// Where it is in the step that follows `step` steps of the scene.
    glm::dvec3 at_step(std::int64_t step, double time_step) const {
        return at(double(step / every) * every * time_step);
    }
};

/// The motion that CSV `text` says, with times and lengths multiplied by these. `file` is what messages name.
/// Throws BadInput, naming line and column, where something is missing or no finite number, where a time is
/// not later than the one before, or where the recording has a gap: an interval of more than ten times the
/// median.
ToolMotion parse_tool_motion(std::string_view text, const std::string& file, double time_scale,
                             double length_scale);
/// The same of a file, of at most 64 MiB.
ToolMotion read_tool_motion(const std::string& file, double time_scale, double length_scale);

}  // namespace voxspring
