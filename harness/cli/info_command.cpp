#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "backends/registry.h"
#include "harness/base/json.h"
#include "harness/base/progress.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

std::string bytes_text(std::uint64_t bytes) { return fmt::format("{:.1f} MiB", double(bytes) / (1 << 20)); }

/// A scene and the figures computed from it.
struct SceneFacts {
    Scene scene;
    SpringCounts springs;
    BodyParts parts;
    std::size_t pinned = 0;
    std::map<std::string, std::uint64_t> bytes;  ///< of each backend
    double undamped = 0;                         ///< the stable time step without damping
    std::optional<double> limit;                 ///< the true limit of the time step
    std::string limit_unknown;                   ///< why there is no `limit`
};

SceneFacts facts_of(const std::string& argument, const VolumeOptions& volume) {
    Activity activity;
    activity.begin("reading " + argument);
    SceneFacts facts;
    facts.scene = load_scene(argument, volume);
    const Problem& problem = facts.scene.problem;
    facts.springs = count_springs(problem);
    facts.parts = parts_of(problem);
    for (const auto p : problem.pinned) facts.pinned += p;
    for (const auto& [name, entry] : registry())
        facts.bytes[name] = entry.bytes(problem, BackendSpec::parse(name).options);
    const Problem limiting = with_all_springs(facts.scene);
    facts.undamped = stable_time_step(frequency_bound_squared(limiting), 0);
    activity.begin("computing the limit of the time step by Lanczos' iteration");
    const Frequency frequency = true_frequency_squared(limiting);
    if (frequency.squared) {
        facts.limit = stable_time_step(*frequency.squared, problem.damping);
    } else {
        facts.limit_unknown = frequency.reason;
    }
    return facts;
}

template <class Value>
void row(std::ostream& out, const std::string& name, const Value& value) {
    out << fmt::format("{:<18}{}\n", name, value);
}

std::string triple(const glm::ivec3& v) { return fmt::format("{} x {} x {}", v.x, v.y, v.z); }
std::string triple(const glm::dvec3& v) { return fmt::format("{:g} x {:g} x {:g}", v.x, v.y, v.z); }

/// The axes in words: "x to the left, y to the posterior, z to the superior".
std::string orientation(const Placement& placement) {
    if (placement.space.empty()) return "none: its axes are not said to be those of a body";
    std::string text;
    constexpr double said = 5;  // degrees; smaller angles are not mentioned
    for (int axis = 0; axis < 3; ++axis) {
        const auto [side, degrees] = nearest_side(placement, axis);
        text += fmt::format("{}{} to the {}", axis > 0 ? ", " : "", "xyz"[axis],
                            anatomical_sides[std::size_t(side)]);
        if (degrees > said) text += fmt::format(" ({:.0f} degrees off)", degrees);
    }
    return text;
}

/// What a volume's file says besides its voxels; null if the dataset is not a volume.
nlohmann::json volume_json(const Scene& scene) {
    if (!scene.volume) return nullptr;
    const VolumeFacts& volume = *scene.volume;
    nlohmann::json labels = nlohmann::json::array(), placement;
    for (const auto& [name, voxels] : volume.labels) labels.push_back({{"name", name}, {"voxels", voxels}});
    if (volume.placement) {
        const auto list = [](const glm::dvec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
        placement = {{"space", volume.placement->space}, {"origin", list(volume.placement->origin)}};
        for (const glm::dvec3& direction : volume.placement->direction)
            placement["directions"].push_back(list(direction));
    }
    return {{"unit", volume.unit},   {"spacing_chosen", volume.spacing_chosen},
            {"frame", volume.frame}, {"frames", volume.frames},
            {"labels", labels},      {"placement", placement}};
}

/// The text that follows the spacing: its unit, or that it was chosen instead of the file's.
std::string unit_text(const Scene& scene) {
    if (!scene.volume) return "";
    if (scene.volume->spacing_chosen) return ", instead of the file's";
    return scene.volume->unit.empty() ? ", the file names no unit" : " " + scene.volume->unit;
}

void print_volume(const VolumeFacts& volume, std::ostream& out) {
    row(out, "orientation", volume.placement ? orientation(*volume.placement) : "none in the file");
    if (volume.placement) {
        const glm::dvec3& origin = volume.placement->origin;
        row(out, "origin",
            fmt::format("{:g}, {:g}, {:g} {}", origin.x, origin.y, origin.z, volume.placement->space));
    }
    if (volume.frames > 1)
        row(out, "frame", fmt::format("{} of {}, counted from 0", volume.frame, volume.frames));
    for (const auto& [name, voxels] : volume.labels)
        row(out, "label", fmt::format("{}: {} voxel{}", name, voxels, voxels == 1 ? "" : "s"));
}

nlohmann::json to_json(const SceneFacts& facts) {
    const Scene& scene = facts.scene;
    const Problem& problem = scene.problem;
    const glm::ivec3 dims = problem.lattice.dims;
    const glm::dvec3 spacing = problem.lattice.spacing;
    nlohmann::json limit, unknown, stable_over_limit;
    if (facts.limit) {
        limit = *facts.limit;
        stable_over_limit = scene.stable_time_step / *facts.limit;
    } else {
        unknown = facts.limit_unknown;
    }
    return {
        {"scene", scene.name},
        {"description", scene.description},
        {"dims", {dims.x, dims.y, dims.z}},
        {"spacing", {spacing.x, spacing.y, spacing.z}},
        {"voxels", problem.lattice.voxel_count()},
        {"active_particles", problem.particle_count()},
        {"pinned_particles", facts.pinned},
        {"parts", facts.parts.sizes.size()},
        {"largest_part_particles", facts.parts.sizes.front()},
        {"loose_particles", facts.parts.loose().size()},
        {"materials", problem.materials.size()},
        {"springs",
         {{"face", facts.springs.group[0]},
          {"edge", facts.springs.group[1]},
          {"corner", facts.springs.group[2]},
          {"total", facts.springs.total()}}},
        {"time_step", problem.time_step},
        {"stable_time_step", scene.stable_time_step},
        {"stable_time_step_undamped", facts.undamped},
        {"time_step_limit", limit},
        {"time_step_limit_unknown", unknown},
        {"stable_over_limit", stable_over_limit},
        {"fraction_of_stable", problem.time_step / scene.stable_time_step},
        {"damping", problem.damping},
        {"edits", scene.edits.size()},
        {"held_particles", problem.tool.particles.size()},
        {"notes", scene.notes},
        {"volume", volume_json(scene)},
        {"bytes", facts.bytes},
    };
}

void print_body(const SceneFacts& facts, std::ostream& out) {
    const Scene& scene = facts.scene;
    const Problem& problem = scene.problem;
    row(out, "scene", scene.name);
    if (!scene.description.empty()) row(out, "", scene.description);
    for (const std::string& note : scene.notes) row(out, "note", note);
    row(out, "dims", triple(problem.lattice.dims));
    row(out, "spacing", triple(problem.lattice.spacing) + unit_text(scene));
    if (scene.volume) print_volume(*scene.volume, out);
    row(out, "voxels", problem.lattice.voxel_count());
    row(out, "active particles", problem.particle_count());
    row(out, "pinned particles", facts.pinned);
    row(out, "materials", problem.materials.size());
    const auto& [face, edge, corner] = facts.springs.group;
    row(out, "springs",
        fmt::format("{} (face {}, edge {}, corner {})", facts.springs.total(), face, edge, corner));
    row(out, "damping", fmt::format("{:g}", problem.damping));
    if (!scene.edits.empty()) {
        row(out, "edits",
            fmt::format("{}, the last after step {}", scene.edits.size(), scene.edits.back().step));
    }
    if (problem.has_tool()) {
        row(out, "tool",
            fmt::format("holds {}; its motion ends after step {:.0f}",
                        counted(problem.tool.particles.size(), "particle"),
                        scene.tool_motion.time.back() / problem.time_step));
    }
}

void print_time_step(const SceneFacts& facts, std::ostream& out) {
    const Scene& scene = facts.scene;
    const double time_step = scene.problem.time_step;
    row(out, "time step",
        fmt::format("{:g} ({} of the stable {:g})", time_step,
                    percent_text(time_step / scene.stable_time_step), scene.stable_time_step));
    row(out, "  undamped", fmt::format("{:g} would be stable", facts.undamped));
    row(out, "  limit",
        facts.limit ? fmt::format("{:g} by Lanczos' iteration, of which the stable one is {:.4g}%",
                                  *facts.limit, 100 * scene.stable_time_step / *facts.limit)
                    : "unknown: " + facts.limit_unknown);
}

void print_memory(const SceneFacts& facts, std::ostream& out) {
    out << "memory\n";
    for (const auto& [name, bytes] : facts.bytes)
        out << fmt::format("  {:<26}{:>12}\n", name, bytes_text(bytes));
}

}  // namespace

void describe_scene(const std::string& argument, const VolumeOptions& volume, bool json, std::ostream& out) {
    const SceneFacts facts = facts_of(argument, volume);
    if (json) {
        out << json_text(to_json(facts), 2) << "\n";
        return;
    }
    print_body(facts, out);
    print_time_step(facts, out);
    print_memory(facts, out);
}

}  // namespace voxspring
