#include <fmt/format.h>

#include <cmath>
#include <cstddef>
#include <glm/vec3.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <ostream>
#include <string>

#include "backends/registry.h"
#include "harness/base/json.h"
#include "harness/base/progress.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/mesh/voxelise.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

template <class Value>
void row(std::ostream& out, const std::string& name, const Value& value) {
    out << fmt::format("{:<18}{}\n", name, value);
}

std::string triple(const glm::ivec3& v) { return fmt::format("{} x {} x {}", v.x, v.y, v.z); }
std::string triple(const glm::dvec3& v) { return fmt::format("{:g} x {:g} x {:g}", v.x, v.y, v.z); }

/// The anatomical directions of the axes in words: "x to the left, y to the posterior, z to the superior".
std::string orientation(const Placement& placement) {
    if (placement.space.empty()) return "none: the file does not say where left, anterior and superior are";
    std::string text;
    constexpr double said = 5;  // the smallest angle in degrees that is mentioned
    for (int axis = 0; axis < 3; ++axis) {
        const auto [side, degrees] = nearest_side(placement, axis);
        text += fmt::format("{}{} to the {}", axis > 0 ? ", " : "", "xyz"[axis],
                            anatomical_sides[std::size_t(side)]);
        if (degrees > said) text += fmt::format(" ({:.0f} degrees off)", degrees);
    }
    return text;
}

/// What a volume file says besides the values of voxels; null if the dataset is not a volume.
nlohmann::json volume_json(const Scene& scene) {
    if (!scene.volume || scene.mesh) return nullptr;
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

/// The mesh that the voxels were made from; null if there is none.
nlohmann::json mesh_json(const Scene& scene) {
    if (!scene.mesh) return nullptr;
    const MeshInGrid& mesh = *scene.mesh;
    const MeshFacts& facts = mesh.facts;
    return {{"vertices", facts.vertices},
            {"triangles", facts.triangles},
            {"tetrahedra", facts.tetrahedra},
            {"parts", facts.parts},
            {"open_edges", facts.open_edges},
            {"holes", facts.holes},
            {"non_manifold_edges", facts.non_manifold_edges},
            {"flat_triangles", facts.flat},
            {"turned_triangles", facts.turned},
            {"origin", {mesh.origin.x, mesh.origin.y, mesh.origin.z}},
            {"pitch", mesh.pitch},
            {"fill", mesh.fill},
            {"volume", mesh.volume},
            {"volume_by_divergence", facts.volume},
            {"body_volume", mesh.body_volume},
            {"volume_error", mesh.body_volume / mesh.volume - 1}};
}

void print_mesh(const MeshInGrid& mesh, std::ostream& out) {
    const MeshFacts& facts = mesh.facts;
    row(out, "mesh",
        fmt::format("{}{} triangles, {} vertices, {}",
                    facts.tetrahedra > 0 ? fmt::format("{} tetrahedra, ", facts.tetrahedra) : "",
                    facts.triangles, facts.vertices, counted(facts.parts, "part")));
    row(out, "  holes",
        fmt::format("{}, of {} open edges; {} non-manifold edges", facts.holes, facts.open_edges,
                    facts.non_manifold_edges));
    row(out, "  volume",
        fmt::format("{:.6g} where its winding number exceeds 1/2; {:.6g} by the divergence theorem{}",
                    mesh.volume, facts.volume, facts.holes > 0 ? ", with holes closed by fans" : ""));
    row(out, "  body",
        fmt::format("{:.6g}, {:+.2g}%: voxels of side {:g} whose filled share is at least {:g}",
                    mesh.body_volume, 100 * (mesh.body_volume / mesh.volume - 1), mesh.pitch, mesh.fill));
}

/// The material and damping of a scene in physical units; null if the scene has no such units.
nlohmann::json world_json(const Scene& scene) {
    if (!scene.world) return nullptr;
    nlohmann::json tissues = nlohmann::json::array();
    for (const Tissue& tissue : scene.world->tissues)
        tissues.push_back({{"label", tissue.label},
                           {"young", tissue.young},
                           {"poisson", poisson_ratio},
                           {"density", tissue.density},
                           {"pressure_wave_speed", tissue.pressure_wave()},
                           {"shear_wave_speed", tissue.shear_wave()}});
    return {{"unit_of_length", scene.world->length},
            {"unit_of_force", scene.world->force()},
            {"damping_per_second", scene.damping_per_second},
            {"tissues", tissues}};
}

void print_world(const WorldUnits& world, std::ostream& out) {
    for (const Tissue& tissue : world.tissues)
        row(out, "material",
            fmt::format("{}E {:g} Pa, nu {:g}, {:g} kg/m^3; waves {:.3g} m/s (pressure), {:.3g} m/s (shear)",
                        tissue.label.empty() ? "" : tissue.label + ": ", tissue.young, poisson_ratio,
                        tissue.density, tissue.pressure_wave(), tissue.shear_wave()));
}

/// The text to print after the spacing: its unit, or that the user chose a spacing instead of the file's.
std::string unit_text(const Scene& scene) {
    if (scene.world) return " " + scene.world->length;
    if (!scene.volume) return "";
    if (scene.mesh) return ", in the unit of the mesh";
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

nlohmann::json facts_of(const Scene& scene) {
    const Problem& problem = scene.problem;
    const glm::ivec3 dims = problem.lattice.dims;
    const glm::dvec3 spacing = problem.lattice.spacing;
    const SpringCounts springs = count_springs(problem);
    const BodyParts parts = parts_of(problem);
    const Problem limiting = with_all_springs(scene);
    Activity activity;
    activity.begin("computing the limit of the time step by Lanczos' iteration");
    const Frequency frequency = true_frequency_squared(limiting);
    nlohmann::json limit, unknown, stable_over_limit, bytes;
    if (!std::isfinite(scene.stable_time_step)) {
        unknown = "nothing oscillates";
    } else if (frequency.squared) {
        const double seconds = stable_time_step(*frequency.squared, problem.damping);
        limit = seconds;
        stable_over_limit = scene.stable_time_step / seconds;
    } else {
        unknown = frequency.reason;
    }
    const double undamped = scene.damping_per_second > 0
                                ? scene.stable_time_step
                                : stable_time_step(frequency_bound_squared(limiting), 0);
    for (const auto& [name, entry] : registry())
        bytes[name] = entry.bytes(problem, BackendSpec::parse(name).options);
    return {
        {"scene", scene.name},
        {"description", scene.description},
        {"dims", {dims.x, dims.y, dims.z}},
        {"spacing", {spacing.x, spacing.y, spacing.z}},
        {"voxels", problem.lattice.voxel_count()},
        {"active_particles", problem.particle_count()},
        {"pinned_particles", std::accumulate(problem.pinned.begin(), problem.pinned.end(), std::size_t(0))},
        {"parts", parts.sizes.size()},
        {"largest_part_particles", parts.sizes.front()},
        {"loose_particles", parts.loose().size()},
        {"materials", problem.materials.size()},
        {"springs",
         {{"face", springs.group[0]},
          {"edge", springs.group[1]},
          {"corner", springs.group[2]},
          {"total", springs.total()}}},
        {"time_step", problem.time_step},
        {"stable_time_step", scene.stable_time_step},
        {"stable_time_step_undamped", undamped},
        {"time_step_limit", limit},
        {"time_step_limit_unknown", unknown},
        {"stable_over_limit", stable_over_limit},
        {"fraction_of_stable", problem.time_step / scene.stable_time_step},
        {"damping", problem.damping},
        {"edits", scene.edits.size()},
        {"held_particles", problem.tool.particles.size()},
        {"notes", scene.notes},
        {"volume", volume_json(scene)},
        {"mesh", mesh_json(scene)},
        {"world", world_json(scene)},
        {"bytes", bytes},
    };
}

void print(const Scene& scene, const nlohmann::json& facts, std::ostream& out) {
    const Problem& problem = scene.problem;
    const auto number = [&](const char* key) { return facts.at(key).get<double>(); };
    row(out, "scene", scene.name);
    if (!scene.description.empty()) row(out, "", scene.description);
    for (const std::string& note : scene.notes) row(out, "note", note);
    row(out, "dims", triple(problem.lattice.dims));
    row(out, "spacing", triple(problem.lattice.spacing) + unit_text(scene));
    if (scene.mesh) {
        print_mesh(*scene.mesh, out);
    } else if (scene.volume) {
        print_volume(*scene.volume, out);
    }
    row(out, "voxels", problem.lattice.voxel_count());
    row(out, "active particles", problem.particle_count());
    row(out, "pinned particles", number("pinned_particles"));
    row(out, "materials", problem.materials.size());
    const auto springs = facts.at("springs").get<std::map<std::string, std::size_t>>();
    const std::size_t of_groups = springs.at("face") + springs.at("edge") + springs.at("corner");
    row(out, "springs",
        fmt::format("{} (face {}, edge {}, corner {}{})", springs.at("total"), springs.at("face"),
                    springs.at("edge"), springs.at("corner"),
                    springs.at("total") > of_groups
                        ? fmt::format(", not of the lattice {}", springs.at("total") - of_groups)
                        : ""));
    if (scene.world) print_world(*scene.world, out);
    row(out, "damping",
        fmt::format("{:g}", problem.damping) +
            (scene.damping_per_second > 0
                 ? fmt::format(" per step, {:g} per second", scene.damping_per_second)
                 : ""));
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
    const bool is_limited = std::isfinite(scene.stable_time_step);
    row(out, "time step",
        fmt::format("{:g}{}{}", problem.time_step, scene.world ? " s" : "",
                    is_limited
                        ? fmt::format(" ({} of the stable {:g})", percent_text(number("fraction_of_stable")),
                                      scene.stable_time_step)
                        : "; every time step is stable"));
    if (is_limited)
        row(out, "  undamped", fmt::format("{:g} would be stable", number("stable_time_step_undamped")));
    row(out, "  limit",
        facts.at("time_step_limit").is_null()
            ? (is_limited ? "unknown: " : "none: ") + facts.at("time_step_limit_unknown").get<std::string>()
            : fmt::format("{:g} by Lanczos' iteration; the stable time step is {:.4g}% of it",
                          number("time_step_limit"), 100 * number("stable_over_limit")));
    out << "memory\n";
    for (const auto& [name, bytes] : facts.at("bytes").items())
        out << fmt::format("  {:<26}{:>8.1f} MiB\n", name, bytes.get<double>() / (1 << 20));
}

}  // namespace

void describe_scene(const std::string& argument, const VolumeOptions& volume, bool json, std::ostream& out) {
    Activity activity;
    activity.begin("reading " + argument);
    const Scene scene = load_scene(argument, volume);
    activity.end();
    const nlohmann::json facts = facts_of(scene);
    if (json) {
        out << json_text(facts, 2) << "\n";
    } else {
        print(scene, facts, out);
    }
}

}  // namespace voxspring
