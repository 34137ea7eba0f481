// A scene: what is simulated, from which state and with which time step. harness/scenes/README.md describes
// the file format; results/scene.schema.json is its schema.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/problem.h"
#include "harness/scene/parts.h"
#include "harness/scene/tool_motion.h"
#include "harness/scene/units.h"
#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

struct MeshInGrid;  // harness/mesh/voxelise.h

/// A change of springs that is made after `step` steps.
struct ScheduledEdit {
    int step = 0;
    SpringDifference edit;
};

struct Scene {
    /// The scene's name in result rows: the built-in name, or the name of the scene file, volume file or mesh
    /// without its folder, followed by "@WxHxD" or "@N" if the argument resized it. The name has no '/'.
    /// Scenes from different folders may have the same name.
    std::string name;
    std::string source;  ///< the argument from which the scene was loaded; empty if it was built in memory
    std::string description;  ///< one sentence; may be empty
    Problem problem;
    State state;  ///< the state at step 0; a list of zeros may be left empty
    /// Sorted by step. Each edit applies to the springs that the edits before it have left.
    std::vector<ScheduledEdit> edits;
    /// The motion of Problem::tool. If it is empty the tool, if any, stays where it took hold.
    ToolMotion tool_motion = {};
    /// stable_time_step() (stability.h) with all springs that edits add: a lower bound of the largest time
    /// step that is stable for small displacements. Infinite if nothing oscillates.
    double stable_time_step = 0;
    /// Present if the voxels come from a volume file or a mesh. A mesh has only VolumeFacts::placement.
    std::optional<VolumeFacts> volume = {};
    std::shared_ptr<const MeshInGrid> mesh = {};  ///< null unless the voxels come from a mesh
    /// What the loader guessed, rounded or left out, for the user to know. Each note begins with a small
    /// letter, a number or a name, and has no full stop.
    std::vector<std::string> notes = {};
    std::optional<WorldUnits> world = {};  ///< present if the scene gives Young's modulus
    /// 0 also if the scene gives damping per step. If it is not 0, loading has changed masses and gravity so
    /// that the stable time step is that of the undamped body.
    double damping_per_second = 0;
};

/// Writes the notes to standard error, one per line. The commands that run scenes call it once per scene;
/// `info` prints the notes itself.
void say_notes(const Scene& scene);

/// Whether a process that runs the scene on a device needs much memory and many processors. More than a few
/// such processes slow each other down.
inline bool is_heavy(const Scene& scene) {
    constexpr std::size_t particles = std::size_t(1) << 20;
    return scene.problem.particle_count() > particles;
}

/// Loads the scene `argument`: a built-in scene ("box"), a scene file (*.json), a volume file
/// (volume_endings()) or a mesh (mesh_endings()). A volume or mesh is simulated with the parameters of the
/// built-in scene `heart`. That scene pins one side of its body along an axis. A volume or mesh that is only
/// one slice thick along this axis is pinned at a side of its longest axis instead. "@N" or "@WxHxD" after a
/// built-in name or a scene file gives its box or heart other dims: "box@64", "heart@120x102x92".
///
/// Throws BadInput. Reading a file allocates memory in proportion to what was really read. No grid exceeds
/// `limits`.
Scene load_scene(const std::string& argument,
                 const SceneSizeLimits& limits = SceneSizeLimits::of_this_machine());

/// Whether `name` is that of a volume file or a mesh, for which load_scene() takes options.
bool is_body_file(const std::string& name);

/// Which voxels of a volume file or a mesh form the body. Options or a scene file make this choice.
struct BodyChoice {
    /// Labels of a volume: whole numbers or names of segments, without duplicates. Never given together with
    /// a threshold.
    std::optional<std::vector<std::string>> labels;
    std::optional<double> threshold;    ///< for a volume
    std::optional<std::int64_t> frame;  ///< for a volume: which of several values per voxel, counted from 0
    std::optional<PartsToKeep> parts;   ///< for a box or a heart as well; absent: all parts
    /// Edge length of the voxels to make. Absent: a volume keeps its voxels, and a mesh gets default_pitch().
    std::optional<double> pitch;
    /// A voxel is active if at least this fraction of it is filled. A volume may have this only together with
    /// `pitch`.
    std::optional<double> fill;
};

/// Options for a volume file or a mesh without a scene file. Absent ones come from the file or from the scene
/// `heart`.
struct VolumeOptions : BodyChoice {
    std::optional<glm::dvec3> spacing;
    /// If it is absent, gravity is that of the scene `heart`, with each component multiplied by the spacing
    /// along its axis. The body then sags by the same number of voxels in any unit of length.
    std::optional<glm::dvec3> gravity;
    /// Young's modulus in Pa and density in kg/m^3: both or neither. With them `gravity` is in m/s^2, and if
    /// it is absent gravity is 9.81 m/s^2 in the direction of the gravity of the scene `heart`.
    std::optional<double> young, density;
    std::optional<std::string> unit;  ///< unit of length, one of accepted_lengths(); absent: the file's unit
    std::optional<double> damping;    ///< per second
    bool corners = false;             ///< particles are at the corners of voxels

    /// The options that are given, as `voxspring run` takes them, quoted for a shell: " --pitch 2 --fill
    /// 0.3".
    std::string text() const;
    bool any() const { return !text().empty(); }
};

/// Loads a scene with options for a volume file or mesh. Throws BadInput if an option is given that
/// `argument` does not take.
Scene load_scene(const std::string& argument, const VolumeOptions& volume,
                 const SceneSizeLimits& limits = SceneSizeLimits::of_this_machine());

/// The scene that the JSON `text` describes. Messages name `file`. Paths in the text are relative to the
/// folder of `file`. The scene's name is that of `file` without the folder.
Scene parse_scene(const std::string& text, const std::string& file, const SceneSizeLimits& limits);

/// Makes a scene, without edits, of a problem that was built in memory. An empty list in `state` stands for
/// zeros; for a body at rest both lists may be empty. A time step of 0 is replaced by half of the stable one.
/// Throws std::invalid_argument, whose message says what is wrong: the name is empty or has a '/' or a blank,
/// an array does not have one element per particle (or none, where that is allowed), a number or index is
/// outside its range, or masks, pins, voxels and rest positions contradict each other.
Scene scene_of(const std::string& name, Problem problem, State state = {});

/// The scene's problem with every spring that any of its edits adds. The stable time step is computed for
/// this problem.
Problem with_all_springs(const Scene& scene);

/// A scene or a study that is built into the program.
struct Named {
    std::string name;
    std::string description;
};
/// All built-in scenes, sorted by name.
std::vector<Named> builtin_scenes();

}  // namespace voxspring
