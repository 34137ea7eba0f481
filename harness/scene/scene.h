// A scene: what is simulated, from which state, with which time step. harness/scenes/README.md describes the
// file format, results/scene.schema.json publishes it.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/problem.h"
#include "harness/scene/parts.h"
#include "harness/scene/tool_motion.h"
#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

/// A change of springs after `step` steps.
struct ScheduledEdit {
    int step = 0;
    SpringDifference edit;
};

struct Scene {
    /// What result rows call it: the built-in name, or the name of the scene file or volume file without its
    /// folder, with "@WxHxD" or "@N" where the argument resized it. Has no '/'. Files in different folders
    /// may share it.
    std::string name;
    std::string source;       ///< the argument that it was loaded from; empty for one built in memory
    std::string description;  ///< one sentence; may be empty
    Problem problem;
    State state;  ///< at step 0; a list of zeros is left out
    /// By step; each one's springs are those that the edits before it left.
    std::vector<ScheduledEdit> edits;
    /// Of Problem::tool; empty: it stays where it took hold, if there is one.
    ToolMotion tool_motion = {};
    /// The largest stable time step for small displacements (stability.h), with the springs that edits add;
    /// infinite where nothing oscillates.
    double stable_time_step = 0;
    std::optional<VolumeFacts> volume = {};  ///< where the voxels come from a volume file
    /// What loading guessed, rounded or left out, for the user to know: a sentence each, which begins with a
    /// small letter and has no full stop.
    std::vector<std::string> notes = {};
};

/// Writes the notes to standard error, a line each. Every command that loads a scene does so once.
void say_notes(const Scene& scene);

/// Whether a process that has its state on a device takes much memory and many processors: more than a few
/// such processes get into each other's way.
inline bool is_heavy(const Scene& scene) {
    constexpr std::size_t particles = std::size_t(1) << 20;
    return scene.problem.particle_count() > particles;
}

/// `argument` is a built-in scene ("box"), a scene file (*.json) or a volume file (volume_endings()), which
/// is simulated with the parameters of the built-in scene `heart`; where it is one slice thick along the axis
/// at whose side the heart is pinned, it is pinned along its longest axis. "@N" or "@WxHxD" after a built-in
/// name or a scene file gives its box or heart other dims: "box@64", "heart@120x102x92".
///
/// Throws BadInput. Allocates in proportion to what was really read and never beyond `limits`.
Scene load_scene(const std::string& argument,
                 const SceneSizeLimits& limits = SceneSizeLimits::of_this_machine());

/// What is asked of a volume that has no scene file; what is not comes from the file or from the scene
/// `heart`.
struct VolumeOptions {
    /// Whole numbers or names of segments, each once; never together with a threshold.
    std::optional<std::vector<std::string>> labels;
    std::optional<double> threshold;
    std::optional<std::int64_t> frame;  ///< which of several values per voxel, from 0 on
    std::optional<glm::dvec3> spacing;
    /// Absent: that of the scene `heart`, each component times the spacing along its axis, so that the body
    /// sags by as many voxels in any unit of length.
    std::optional<glm::dvec3> gravity;
    std::optional<PartsToKeep> parts;  ///< absent: all

    bool any() const { return labels || threshold || frame || spacing || gravity || parts; }
};

/// The same, of a volume with these options. Throws BadInput if there are any and `argument` is no volume
/// file.
Scene load_scene(const std::string& argument, const VolumeOptions& volume,
                 const SceneSizeLimits& limits = SceneSizeLimits::of_this_machine());

/// The scene that the JSON `text` describes. `file` is what messages name and what a volume's path is
/// relative to; without its folder it is the scene's name.
Scene parse_scene(const std::string& text, const std::string& file, const SceneSizeLimits& limits);

/// The scene of a problem that was built in memory, without edits. Each list of `state` may be empty, which
/// both are for a body at rest. A time step of 0 becomes half of the stable one. Throws
/// std::invalid_argument, saying what, where a name has a '/' or a blank, an array is neither empty, where it
/// may be, nor of one element a particle, or a number or an index is out of its range.
Scene scene_of(const std::string& name, Problem problem, State state = {});

/// The problem with every spring that an edit of the scene ever adds beyond its lattice: what limits the time
/// step.
Problem with_all_springs(const Scene& scene);

struct BuiltinScene {
    std::string name;
    std::string description;
};
/// By name.
std::vector<BuiltinScene> builtin_scenes();

}  // namespace voxspring
