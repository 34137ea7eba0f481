// The content of a scene file, before any voxel is made. The reader accepts what results/scene.schema.json
// accepts, except that it also checks the range of a number in a text with a unit; scene.cpp and
// edit_schedule.cpp check what depends on the voxels.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/json.h"
#include "harness/scene/scene.h"

namespace voxspring {

enum class DatasetType : std::uint8_t { box, heart, volume, mesh };

struct DatasetSpec : BodyChoice {
    DatasetType type = DatasetType::box;
    glm::ivec3 dims{0};      ///< number of voxels of a box or heart along each axis
    double missing = 0;      ///< probability with which each voxel of a box or heart is left out
    std::uint64_t seed = 0;  ///< for the random choice of the voxels left out
    std::string file;        ///< path of a volume or mesh, relative to the scene file
    /// JSON value of `file`, for messages; absent without a scene file.
    std::optional<JsonValue> file_source;
    std::optional<JsonValue> parts_source;  ///< JSON value of `parts`, for messages

    bool is_from_file() const { return type == DatasetType::volume || type == DatasetType::mesh; }
};

/// A material parameter: one value for the whole body, one per spring group or one per label. Exactly one of
/// the three is given.
struct Parameter {
    std::optional<double> everywhere;
    std::map<SpringGroup, double> by_group;
    std::map<std::string, double> by_label;  ///< each key is one of the names of a label (Label::words)
    std::optional<JsonValue> source;         ///< JSON value, for messages; absent for a default
};

/// Particles chosen by location. If `at_side`, they are those in the outermost slices on a side of the grid,
/// counted from the first slice that has particles. Otherwise they are those in the box of voxels from `from`
/// to `to`, both included.
struct Region {
    bool at_side = false;
    /// An anatomical side, if one is given. Loading sets `axis` and `upper` to the nearest side of the grid.
    std::optional<AnatomicalSide> anatomical{};
    int axis = 0;        ///< axis that the side is perpendicular to: 0, 1 or 2
    bool upper = false;  ///< whether it is the side with the larger coordinate
    int slices = 1;      ///< number of slices, counted from the side inward
    /// If > 0, replaces `slices`: the region covers this fraction of the particles' extent along `axis`,
    /// rounded to whole slices, and at least one slice.
    double fraction = 0;
    glm::ivec3 from{0};
    glm::ivec3 to{0};
    JsonValue source;  ///< JSON value, for messages
};

/// Gravity given by the side that it pulls towards.
struct GravityTowards {
    std::optional<AnatomicalSide> anatomical{};  ///< absent: `axis` and `upper` give a side of the grid
    int axis = 0;
    bool upper = false;
    double strength = 0;
    JsonValue source;  ///< value of the side, for messages
};

struct PointLoad {
    Region region;
    glm::dvec3 force{0};  ///< on each particle of the region
};

/// An initial vector field: the same vector for every particle, or seeded random components within
/// +-amplitude.
struct InitialField {
    glm::dvec3 vector{0};
    double amplitude = 0;  ///< 0: the field is not random
    std::uint64_t seed = 0;
    std::optional<Region> region{};  ///< the field is zero outside; absent: all particles
};

struct TimeStep {
    double fraction = 0.8;
    /// Whether `fraction` is a fraction of the true limit of stability, instead of stable_time_step(problem),
    /// which is a lower bound of that limit (stability.h).
    bool of_limit = false;
    std::optional<double> absolute;  ///< the time step itself; replaces `fraction`
    std::optional<JsonValue> source;
};

/// A cut or a suture, made once or several times.
struct EditSpec {
    int step = 0;  ///< the edit is first made after this number of steps
    bool suture = false;
    std::optional<Shape> shape{};                             ///< absent for a suture that names voxels
    std::vector<std::pair<glm::ivec3, glm::ivec3>> voxels{};  ///< pairs of voxels that the suture joins
    double within = 0;                  ///< for a suture by shape: the longest spring that it adds
    std::optional<double> stiffness{};  ///< of the springs that a suture adds
    int times = 1, every = 0;           ///< how often the edit is made, and the steps between
    glm::dvec3 move{0};                 ///< translation of the shape from one repetition to the next
    JsonValue source;                   ///< JSON value, for messages
};

/// A tool that holds the particles of a region and follows the recorded motion of a hand.
struct ToolSpec {
    Region region;
    double stiffness = 1;
    std::string motion;                       ///< the motion file, relative to the scene file
    JsonValue motion_source;                  ///< JSON value, for messages
    double time_scale = 1, length_scale = 1;  ///< units of the scene per unit of the motion file
    int every = 1;                            ///< number of steps between two moves of the tool
};

struct SceneFile {
    std::string description;
    DatasetSpec dataset;
    std::vector<SpringGroup> spring_groups{SpringGroup::face, SpringGroup::edge};
    std::optional<glm::dvec3> spacing;
    Parameter mass;  ///< never given per spring group
    Parameter stiffness;
    std::optional<Parameter> young, density;  ///< Pa, kg/m^3; both or neither; replace stiffness and mass
    /// Unit of length if `young` is given; absent: that of the volume file.
    std::optional<std::string> unit;
    bool corners = false;  ///< particles are at the corners of voxels rather than at their centres
    double damping = 0;
    std::optional<double> damping_per_second;       ///< replaces `damping`
    glm::dvec3 gravity{0};                          ///< in m/s^2 if `young` is given
    std::optional<GravityTowards> gravity_towards;  ///< replaces `gravity`
    /// Whether `gravity` is that of the scene `heart`, as the default of a body without a scene file. It is
    /// multiplied by the spacing, axis by axis, unless `young` is given.
    bool gravity_in_voxels = false;
    TimeStep time_step;
    std::vector<Region> pinned;
    InitialField displacement;
    InitialField velocity;
    std::vector<PointLoad> loads;
    std::vector<EditSpec> edits;
    std::optional<ToolSpec> tool;
};

/// Reads a scene file from its JSON. Throws BadInput.
SceneFile read_scene_file(JsonObject document);

std::string to_string(SpringGroup group);

/// The edits of `specs` in the order in which they are made. Each is computed on `problem` as the edits
/// before it have left it. Repetitions that change no spring are left out. Throws BadInput if a suture names
/// invalid voxels or adds springs longer than eight spacings, if no repetition of an edit changes a spring,
/// if one is due after more than 2^31 - 1 steps, or if the edits exceed `limits`.
std::vector<ScheduledEdit> schedule_edits(const std::vector<EditSpec>& specs, const Problem& problem,
                                          const SceneSizeLimits& limits);

}  // namespace voxspring
