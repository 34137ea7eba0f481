// What a scene file says, before any voxel is made: its keys, checked one by one. What can only be judged
// against the voxels is judged in scene.cpp. Accepts exactly what results/scene.schema.json accepts.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/problem.h"
#include "harness/base/json.h"
#include "harness/scene/parts.h"
#include "harness/volume/volume.h"

namespace voxspring {

enum class DatasetType : std::uint8_t { box, heart, volume };

struct DatasetSpec {
    DatasetType type = DatasetType::box;
    glm::ivec3 dims{0};                    ///< of a box or heart
    double missing = 0;                    ///< share of its voxels, at random
    std::uint64_t seed = 0;                ///< of those
    std::string file;                      ///< of a volume, relative to the scene file
    std::optional<JsonValue> file_source;  ///< for messages; absent for a volume by itself
    std::optional<double> threshold;       ///< of a volume; never together with labels
    /// Of a volume, no label twice: whole numbers, or names of segments.
    std::optional<std::vector<std::string>> labels;
    std::optional<std::int64_t> frame;      ///< of a volume with several values per voxel
    std::optional<PartsToKeep> parts;       ///< absent: all
    std::optional<JsonValue> parts_source;  ///< for messages
};

/// A material parameter: one value, one a spring group, or one a label. One of the three is there.
struct Parameter {
    std::optional<double> everywhere;
    std::map<SpringGroup, double> by_group;
    std::map<std::string, double> by_label;  ///< by any of a label's words
    std::optional<JsonValue> source;         ///< for messages; absent for a default
};

/// Particles chosen by where they are: those in the outermost slices on a side of the grid, counted from the
/// first slice that has any, or those in the voxels from `from` to `to`, both included.
struct Region {
    bool at_side = false;
    std::optional<AnatomicalSide> anatomical{};  ///< which side, until what follows is known
    int axis = 0;                                ///< of the side
    bool upper = false;                          ///< the side with the larger coordinate
    int slices = 1;                              ///< how many from the side
    double fraction =
        0;  ///< > 0, instead of `slices`: of the extent of the active voxels, one slice at least
    glm::ivec3 from{0};
    glm::ivec3 to{0};
    JsonValue source;  ///< for messages
};

/// Gravity that a scene gives by where it pulls to.
struct GravityTowards {
    std::optional<AnatomicalSide> anatomical{};  ///< or, if there is none, along an axis of the grid
    int axis = 0;
    bool upper = false;
    double strength = 0;
    JsonValue source;  ///< of the side, for messages
};

struct PointLoad {
    Region region;
    glm::dvec3 force{0};  ///< on each particle of the region
};

/// An initial vector field: the same vector for every particle, or seeded random components within
/// +-amplitude.
struct InitialField {
    glm::dvec3 vector{0};
    double amplitude = 0;  ///< 0: not random
    std::uint64_t seed = 0;
    std::optional<Region> region{};  ///< the others are at rest; absent: everywhere
};

struct TimeStep {
    double fraction = 0.8;
    bool of_limit = false;           ///< of the true limit rather than of its bound (stability.h)
    std::optional<double> absolute;  ///< instead of the fraction
    std::optional<JsonValue> source;
};

/// A cut or a suture, once or several times.
struct EditSpec {
    int step = 0;  ///< after how many steps
    bool suture = false;
    std::optional<Shape> shape{};                             ///< or, of a suture,
    std::vector<std::pair<glm::ivec3, glm::ivec3>> voxels{};  ///< the voxels that it joins
    double within = 0;                  ///< of a suture by shape: the longest spring that it adds
    std::optional<double> stiffness{};  ///< of a suture
    int times = 1, every = 0;           ///< how often, and how many steps apart
    glm::dvec3 move{0};                 ///< of the shape from one time to the next
    JsonValue source;                   ///< for messages
};

/// A tool that holds the particles of a region while a recorded hand moves it.
struct ToolSpec {
    Region region;
    double stiffness = 1;
    std::string motion;                       ///< the file, relative to the scene file
    JsonValue motion_source;                  ///< for messages
    double time_scale = 1, length_scale = 1;  ///< units of the scene in one of the file
    int every = 1;                            ///< steps for which the tool stays where it is
};

struct SceneFile {
    std::string description;
    DatasetSpec dataset;
    std::vector<SpringGroup> spring_groups{SpringGroup::face, SpringGroup::edge};
    std::optional<glm::dvec3> spacing;
    Parameter mass;  ///< never by group
    Parameter stiffness;
    double damping = 0;
    glm::dvec3 gravity{0};
    std::optional<GravityTowards> gravity_towards;  ///< instead
    bool gravity_in_voxels = false;  ///< to be multiplied by the spacing, axis by axis: nobody has chosen it
    TimeStep time_step;
    std::vector<Region> pinned;
    InitialField displacement;
    InitialField velocity;
    std::vector<PointLoad> loads;
    std::vector<EditSpec> edits;
    std::optional<ToolSpec> tool;
};

/// Throws BadInput.
SceneFile read_scene_file(JsonObject document);

std::string to_string(SpringGroup group);

}  // namespace voxspring
