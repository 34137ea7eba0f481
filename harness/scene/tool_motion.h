// The recorded motion of a tool in a hand. Reads the motion from a file, and says where the tool is at any
// time.
//
// The file is CSV: a first line "time,x,y,z", then a line per sample. The reader multiplies times and lengths
// by factors that convert them to the scene's units. Only the displacement since the first sample counts.
// Between samples the tool moves in a straight line; before the first and after the last sample it rests.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

struct ToolMotion {
    int every = 1;             ///< number of steps between two moves of the tool
    std::vector<double> time;  ///< time of each sample, ascending from 0, in the scene's unit
    /// How far the tool has moved at each sample since it took hold, in the scene's unit of length.
    std::vector<glm::dvec3> displacement;

    bool empty() const { return time.empty(); }
    /// The displacement at time `when`. Zero if there are no samples.
    glm::dvec3 at(double when) const;
    /// The displacement during step number `step`, counted from 0. It changes every `every` steps.
    glm::dvec3 at_step(std::int64_t step, double time_step) const {
        const std::int64_t moves = step / every;
        return at(double(moves) * every * time_step);
    }
};

/// The motion in the CSV `text`, with times and lengths multiplied by the given scales. Messages name `file`.
/// Throws BadInput, naming the line, if the header is wrong, if a line is not four numbers from -1e12 to
/// 1e12, if a time is not later than the one before, or if an interval is longer than ten times the median.
/// Also throws BadInput if there are fewer than two samples.
ToolMotion parse_tool_motion(std::string_view text, const std::string& file, double time_scale,
                             double length_scale);
/// Reads `file`, of at most 64 MiB, as parse_tool_motion() reads a text. Throws BadInput.
ToolMotion read_tool_motion(const std::string& file, double time_scale, double length_scale);

}  // namespace voxspring
