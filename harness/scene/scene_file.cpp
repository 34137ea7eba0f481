#include "harness/scene/scene_file.h"

#include <algorithm>
#include <functional>
#include <initializer_list>
#include <set>
#include <string_view>

#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/scene/units.h"
#include "harness/volume/dataset.h"

namespace voxspring {
namespace {

/// The names of the spring groups, in the order of the enumeration.
const std::vector<std::string> group_names = {"face", "edge", "corner"};

constexpr int max_edit_steps = 1'000'000'000;
constexpr int max_edits = 1'000;
constexpr std::size_t max_triangles = 100'000;
constexpr std::size_t max_pairs = 100'000;
constexpr std::int64_t max_frame = 1'000'000'000;

constexpr std::string_view accepted_regions =
    R"({"side": SIDE}, if wanted with "slices": N or "fraction": F; {"from": [x, y, z], "to": [x, y, z]}; )"
    R"(or {"voxel": [x, y, z]})";

double positive(const JsonValue& value) { return value.number(min_quantity, max_quantity); }

glm::dvec3 vector(const JsonValue& value) { return value.vec3(max_quantity); }

/// The number of `keys` that are present.
int keys_given(std::initializer_list<std::optional<JsonValue>> keys) {
    return int(std::count_if(keys.begin(), keys.end(), [](const auto& key) { return key.has_value(); }));
}

/// Reads three whole numbers within [low, high].
glm::ivec3 voxel_triple(const JsonValue& value, int low, int high) {
    const std::vector<JsonValue> list = value.array(3, 3);
    return {int(list[0].integer(low, high)), int(list[1].integer(low, high)),
            int(list[2].integer(low, high))};
}

std::uint64_t required_seed(JsonObject& object) {
    return std::uint64_t(object.require("seed", "a whole number").integer(0, (std::int64_t{1} << 53) - 1));
}

PartsToKeep read_parts(const JsonValue& value) {
    if (value.is_string() && value.string() == "largest") return {};
    if (!value.is_number())
        value.refuse(
            "\"largest\", or the least number of particles of a part to keep: a whole number from 2 on");
    return {std::size_t(value.integer(2, max_part_particles))};
}

DatasetSpec read_dataset(JsonObject object) {
    DatasetSpec dataset;
    const std::string type =
        object.require("type", "box, heart, volume or mesh").one_of({"box", "heart", "volume", "mesh"});
    if (type == "volume" || type == "mesh") {
        dataset.type = type == "mesh" ? DatasetType::mesh : DatasetType::volume;
        dataset.file_source = object.require("file", "the path of a " + type + " file");
        dataset.file = dataset.file_source->string();
        const auto pitch = object.find("pitch"), fill = object.find("fill");
        if (pitch) dataset.pitch = positive(*pitch);
        if (fill) dataset.fill = fill->number(min_quantity, 1);
        if (type == "volume" && fill && !pitch)
            fill->refuse("\"pitch\" as well: without it every voxel is full");
    }
    if (type == "volume") {
        const auto threshold = object.find("threshold");
        const auto labels = object.find("labels");
        if (threshold) dataset.threshold = threshold->number(-max_quantity, max_quantity);
        if (threshold && labels) labels->refuse("either a threshold or labels, not both");
        if (labels) {
            dataset.labels.emplace();
            std::set<std::string> seen;
            for (const JsonValue& label : labels->array(1, max_labels)) {
                const std::string word =
                    label.is_string() ? label.string() : std::to_string(label.integer(-max_label, max_label));
                if (!seen.insert((label.is_string() ? "\"" : "") + word).second)
                    label.refuse("each label once");
                dataset.labels->push_back(word);
            }
        }
        if (const auto frame = object.find("frame")) dataset.frame = frame->integer(0, max_frame);
    } else if (type != "mesh") {
        dataset.type = type == "box" ? DatasetType::box : DatasetType::heart;
        dataset.dims = voxel_triple(object.require("dims", "voxels along x, y and z"), 1, max_side);
        if (const auto missing = object.find("missing")) {
            JsonObject holes = missing->object();
            constexpr double max_share = 0.99;
            dataset.missing =
                holes.require("fraction", "a share of the voxels from 0 to 0.99").number(0, max_share);
            dataset.seed = required_seed(holes);
            holes.finish();
        }
    }
    if (const auto parts = object.find("parts")) {
        dataset.parts_source = parts;
        dataset.parts = read_parts(*parts);
    }
    object.finish();
    return dataset;
}

/// The group with this name; empty if there is none.
std::optional<SpringGroup> group_named(const std::string& name) {
    const auto found = std::find(group_names.begin(), group_names.end(), name);
    if (found == group_names.end()) return {};
    return SpringGroup(found - group_names.begin());
}

std::vector<SpringGroup> read_spring_groups(const JsonValue& value) {
    std::vector<SpringGroup> groups;
    for (const JsonValue& element : value.array(1, group_names.size())) {
        const SpringGroup group = *group_named(element.one_of(group_names));
        if (std::find(groups.begin(), groups.end(), group) != groups.end())
            element.refuse("each spring group once");
        groups.push_back(group);
    }
    return groups;
}

/// Reads a parameter, each value by `read`. In messages `accepted_value` describes a value, and `one` names
/// it. Unless `one` is "number", a value may be a text with a unit.
Parameter read_parameter(const JsonValue& value, bool groups_allowed,
                         const std::function<double(const JsonValue&)>& read = positive,
                         const std::string& accepted_value = "a number", const char* one = "number") {
    Parameter parameter;
    parameter.source = value;
    const std::string accepted = accepted_value + ", or an object with one " + one +
                                 (groups_allowed ? " per spring group or per label" : " per label");
    const bool may_have_unit = std::string_view(one) != "number";
    if (value.is_number() || (value.is_string() && may_have_unit)) {
        parameter.everywhere = read(value);
        return parameter;
    }
    if (!value.is_object()) value.refuse(accepted);
    for (const auto& [key, element] : value.object().items()) {
        const auto group = group_named(key);
        if (group && !groups_allowed)
            throw BadInput(value.file(), value.path(), "the key \"" + key + "\"", accepted);
        (group ? parameter.by_group[*group] : parameter.by_label[key]) = read(element);
    }
    if (parameter.by_group.empty() == parameter.by_label.empty()) value.refuse(accepted);
    return parameter;
}

/// Reads Young's modulus, density and the unit of lengths. `replaced` are mass and stiffness, which must be
/// absent if Young's modulus is given.
void read_units(JsonObject& document, SceneFile& scene,
                std::initializer_list<std::optional<JsonValue>> replaced) {
    const auto with_unit = [](std::optional<double> (*convert)(const std::string&), const char* accepted) {
        return [=](const JsonValue& value) {
            const std::optional<double> number = convert(value.is_string() ? value.string() : value.text());
            if (!number) value.refuse(accepted);
            return *number;
        };
    };
    const auto young = document.find("young");
    const auto density = document.find("density");
    const auto unit = document.find("unit");
    if (unit) scene.unit = unit->one_of({"m", "cm", "mm", "um"});
    if (!young) {
        for (const auto& other : {density, unit}) {
            if (other) other->refuse("this key only together with \"young\", Young's modulus");
        }
        return;
    }
    for (const auto& other : replaced) {
        if (other) other->refuse("either young and density, or stiffness and mass");
    }
    if (!density) document.require("density", accepted_density);
    scene.young =
        read_parameter(*young, false, with_unit(pascals_of, accepted_young), accepted_young, "modulus");
    scene.density = read_parameter(*density, false, with_unit(kilograms_per_cubic_metre_of, accepted_density),
                                   accepted_density, "density");
}

/// Reads a side of the grid ("x-" to "z+") or of the body ("left" and so on). `Side` has the members
/// anatomical, axis and upper.
template <class Side>
void read_side(const JsonValue& value, Side& side) {
    std::vector<std::string> names = {"x-", "x+", "y-", "y+", "z-", "z+"};
    names.insert(names.end(), anatomical_sides.begin(), anatomical_sides.end());
    const std::string name = value.one_of(names);
    const auto found = std::find(anatomical_sides.begin(), anatomical_sides.end(), name);
    if (found != anatomical_sides.end()) {
        side.anatomical = AnatomicalSide(found - anatomical_sides.begin());
    } else {
        side.axis = name[0] - 'x';
        side.upper = name[1] == '+';
    }
}

/// The region that `object` describes; empty if it has no key of a region. The caller reads the other keys.
std::optional<Region> find_region(JsonObject& object) {
    Region region{.source = object.value()};
    const auto side = object.find("side");
    const auto slices = object.find("slices");
    const auto fraction = object.find("fraction");
    const auto voxel = object.find("voxel");
    const auto from = object.find("from");
    const auto to = object.find("to");
    if (keys_given({side, slices, fraction, voxel, from, to}) == 0) return std::nullopt;
    if (keys_given({side, voxel, from}) != 1 || keys_given({from, to}) == 1 ||
        keys_given({slices, fraction}) > (side ? 1 : 0))
        object.value().refuse(accepted_regions);
    if (side) {
        region.at_side = true;
        read_side(*side, region);
        if (slices) region.slices = int(slices->integer(1, max_side));
        if (fraction) region.fraction = fraction->number(min_quantity, 1);
    } else if (voxel) {
        region.from = region.to = voxel_triple(*voxel, 0, max_side - 1);
    } else {
        region.from = voxel_triple(*from, 0, max_side - 1);
        region.to = voxel_triple(*to, 0, max_side - 1);
    }
    return region;
}

Region read_region(JsonObject& object) {
    std::optional<Region> region = find_region(object);
    if (!region) object.value().refuse(accepted_regions);
    return *std::move(region);
}

Region read_region_alone(const JsonValue& value) {
    JsonObject object = value.object();
    Region region = read_region(object);
    object.finish();
    return region;
}

InitialField read_initial_field(const JsonValue& value) {
    InitialField field;
    if (value.is_array()) {
        field.vector = vector(value);
        return field;
    }
    const std::string accepted =
        R"([x, y, z], {"vector": [x, y, z]} or {"random": AMPLITUDE, "seed": NUMBER})"
        "; either object may also have the keys of a region, such as \"side\"";
    if (!value.is_object()) value.refuse(accepted);
    JsonObject object = value.object();
    const auto same = object.find("vector");
    const auto amplitude = object.find("random");
    if (keys_given({same, amplitude}) != 1) value.refuse(accepted);
    if (same) {
        field.vector = vector(*same);
    } else {
        field.amplitude = positive(*amplitude);
        field.seed = required_seed(object);
    }
    field.region = find_region(object);
    object.finish();
    return field;
}

TimeStep read_time_step(const JsonValue& value) {
    TimeStep time_step;
    time_step.source = value;
    if (value.is_number()) {
        time_step.absolute = positive(value);
        return time_step;
    }
    const std::string accepted =
        R"(a number, {"fraction_of_stable": NUMBER} or {"fraction_of_limit": NUMBER})";
    if (!value.is_object()) value.refuse(accepted);
    JsonObject object = value.object();
    const auto of_stable = object.find("fraction_of_stable");
    const auto of_limit = object.find("fraction_of_limit");
    object.finish();
    if (keys_given({of_stable, of_limit}) != 1) value.refuse(accepted);
    time_step.of_limit = of_limit.has_value();
    time_step.fraction = positive(of_limit ? *of_limit : *of_stable);
    return time_step;
}

glm::dvec3 direction(const JsonValue& value) {
    const glm::dvec3 v = vector(value);
    if (v == glm::dvec3(0)) value.refuse("a vector that is not zero");
    return v;
}

/// The shape that `object` gives by the key plane, triangles or ball; empty if it has none of them.
std::optional<Shape> read_shape(JsonObject& object, const std::string& accepted) {
    const auto plane = object.find("plane");
    const auto triangles = object.find("triangles");
    const auto ball = object.find("ball");
    if (keys_given({plane, triangles, ball}) > 1) object.value().refuse(accepted);
    if (plane) {
        JsonObject keys = plane->object();
        Plane shape{vector(keys.require("point", "[x, y, z]")),
                    direction(keys.require("normal", "[x, y, z]"))};
        keys.finish();
        return shape;
    }
    if (triangles) {
        TrianglePatch shape;
        for (const JsonValue& triangle : triangles->array(1, max_triangles)) {
            const std::vector<JsonValue> corners = triangle.array(3, 3);
            shape.triangles.push_back({vector(corners[0]), vector(corners[1]), vector(corners[2])});
        }
        return shape;
    }
    if (ball) {
        JsonObject keys = ball->object();
        Ball shape{vector(keys.require("centre", "[x, y, z]")), positive(keys.require("radius", "a length"))};
        keys.finish();
        return shape;
    }
    return {};
}

EditSpec read_edit(const JsonValue& value) {
    EditSpec edit{.source = value};
    JsonObject object = value.object();
    edit.step = int(object.require("step", "a number of steps").integer(0, max_edit_steps));
    const auto cut = object.find("cut");
    const auto suture = object.find("suture");
    const std::string one_shape = "one of plane, triangles and ball";
    if (keys_given({cut, suture}) != 1) value.refuse("either a cut or a suture");
    edit.suture = suture.has_value();
    JsonObject keys = (cut ? cut : suture)->object();
    edit.shape = read_shape(keys, one_shape);
    if (cut && !edit.shape) cut->refuse(one_shape);
    if (suture) {
        const auto pairs = keys.find("pairs");
        const auto within = keys.find("within");
        if (edit.shape.has_value() == pairs.has_value() || edit.shape.has_value() != within.has_value())
            suture->refuse("pairs of voxels, or " + one_shape + " with a distance \"within\"");
        if (within) edit.within = positive(*within);
        for (const JsonValue& pair : pairs ? pairs->array(1, max_pairs) : std::vector<JsonValue>()) {
            const std::vector<JsonValue> ends = pair.array(2, 2);
            edit.voxels.emplace_back(voxel_triple(ends[0], 0, max_side - 1),
                                     voxel_triple(ends[1], 0, max_side - 1));
        }
        if (const auto stiffness = keys.find("stiffness")) edit.stiffness = positive(*stiffness);
    }
    keys.finish();
    if (const auto repeat = object.find("repeat")) {
        JsonObject how = repeat->object();
        edit.times = int(how.require("times", "a whole number").integer(1, max_edits));
        edit.every = int(how.require("every", "a number of steps").integer(1, max_edit_steps));
        if (const auto move = how.find("move")) {
            if (!edit.shape) move->refuse("a repeat without \"move\": pairs of voxels cannot move");
            edit.move = vector(*move);
        }
        how.finish();
    }
    object.finish();
    return edit;
}

ToolSpec read_tool(const JsonValue& value) {
    JsonObject object = value.object();
    const JsonValue motion = object.require("motion", "the path of a file of times and positions (CSV)");
    ToolSpec tool{.region = read_region(object), .motion = motion.string(), .motion_source = motion};
    tool.stiffness =
        positive(object.require("stiffness", "force per length, of the spring to each particle"));
    if (const auto scale = object.find("time_scale")) tool.time_scale = positive(*scale);
    if (const auto scale = object.find("length_scale")) tool.length_scale = positive(*scale);
    if (const auto every = object.find("every")) tool.every = int(every->integer(1, max_edit_steps));
    object.finish();
    return tool;
}

void read_gravity(const JsonValue& value, SceneFile& scene) {
    if (value.is_array()) {
        scene.gravity = vector(value);
        return;
    }
    if (!value.is_object()) value.refuse(R"([x, y, z] or {"toward": SIDE, "strength": NUMBER})");
    JsonObject object = value.object();
    const JsonValue side = object.require("toward", "a side of the grid or of the body");
    GravityTowards towards{.source = side};
    read_side(side, towards);
    towards.strength = positive(object.require("strength", "an acceleration"));
    object.finish();
    scene.gravity_towards = towards;
}

}  // namespace

std::string to_string(SpringGroup group) { return group_names.at(std::size_t(group)); }

SceneFile read_scene_file(JsonObject document) {
    SceneFile scene;
    if (const auto schema = document.find("$schema")) schema->string();
    check_schema_version(document, scene_schema_version);
    if (const auto text = document.find("description")) scene.description = text->string();
    scene.dataset = read_dataset(document.require("dataset", "a box, heart, volume or mesh").object());
    if (const auto groups = document.find("spring_groups")) scene.spring_groups = read_spring_groups(*groups);
    if (const auto spacing = document.find("spacing")) {
        const std::vector<JsonValue> list =
            spacing->is_array() ? spacing->array(3, 3) : std::vector(3, *spacing);
        scene.spacing = {positive(list[0]), positive(list[1]), positive(list[2])};
    }
    scene.mass.everywhere = 1;
    scene.stiffness.everywhere = 1;
    const auto mass = document.find("mass");
    const auto stiffness = document.find("stiffness");
    if (mass) scene.mass = read_parameter(*mass, false);
    if (stiffness) scene.stiffness = read_parameter(*stiffness, true);
    read_units(document, scene, {mass, stiffness});
    if (const auto particles = document.find("particles"))
        scene.corners = particles->one_of({"centres", "corners"}) == "corners";
    if (const auto damping = document.find("damping")) {
        if (damping->is_object()) {
            JsonObject object = damping->object();
            scene.damping_per_second = object.require("per_second", "a number").number(0, max_quantity);
            object.finish();
        } else {
            scene.damping = damping->number();
            if (!(scene.damping >= 0 && scene.damping < 2))
                damping->refuse("a number from 0 to below 2, per step, or {\"per_second\": NUMBER}");
        }
    }
    if (const auto gravity = document.find("gravity")) read_gravity(*gravity, scene);
    if (const auto time_step = document.find("time_step")) scene.time_step = read_time_step(*time_step);
    if (const auto pinned = document.find("pinned")) {
        if (pinned->is_array()) {
            for (const JsonValue& region : pinned->array()) scene.pinned.push_back(read_region_alone(region));
        } else {
            scene.pinned.push_back(read_region_alone(*pinned));
        }
    }
    if (const auto initial = document.find("initial")) {
        JsonObject object = initial->object();
        if (const auto field = object.find("displacement")) scene.displacement = read_initial_field(*field);
        if (const auto field = object.find("velocity")) scene.velocity = read_initial_field(*field);
        object.finish();
    }
    if (const auto loads = document.find("loads")) {
        for (const JsonValue& element : loads->array()) {
            JsonObject object = element.object();
            Region region = read_region(object);
            scene.loads.push_back(
                {std::move(region), vector(object.require("force", "an array of 3 numbers"))});
            object.finish();
        }
    }
    if (const auto edits = document.find("edits")) {
        for (const JsonValue& element : edits->array()) scene.edits.push_back(read_edit(element));
    }
    if (const auto tool = document.find("tool")) scene.tool = read_tool(*tool);
    document.finish();
    return scene;
}

}  // namespace voxspring
