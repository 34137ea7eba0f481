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

namespace voxspring {
namespace {

std::string bytes_text(std::uint64_t bytes) { return fmt::format("{:.1f} MiB", double(bytes) / (1 << 20)); }

/// A scene and what is computed of it.
struct SceneFacts {
    Scene scene;
    SpringCounts springs;
    std::size_t pinned = 0;
    std::map<std::string, std::uint64_t> bytes;  ///< of each backend
    double undamped = 0;                         ///< the stable time step without damping
    std::optional<double> limit;                 ///< the true limit of the time step
    std::string limit_unknown;                   ///< why there is none
};

SceneFacts facts_of(const std::string& argument, const VolumeOptions& volume) {
    Activity activity;
    activity.begin("reading " + argument);
    SceneFacts facts;
    facts.scene = load_scene(argument, volume);
    const Problem& problem = facts.scene.problem;
    facts.springs = count_springs(problem);
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
        {"bytes", facts.bytes},
    };
}

template <class Value>
void row(std::ostream& out, const std::string& name, const Value& value) {
    out << fmt::format("{:<18}{}\n", name, value);
}

std::string triple(const glm::ivec3& v) { return fmt::format("{} x {} x {}", v.x, v.y, v.z); }
std::string triple(const glm::dvec3& v) { return fmt::format("{:g} x {:g} x {:g}", v.x, v.y, v.z); }

void print_body(const SceneFacts& facts, std::ostream& out) {
    const Scene& scene = facts.scene;
    const Problem& problem = scene.problem;
    row(out, "scene", scene.name);
    if (!scene.description.empty()) row(out, "", scene.description);
    for (const std::string& note : scene.notes) row(out, "note", note);
    row(out, "dims", triple(problem.lattice.dims));
    row(out, "spacing", triple(problem.lattice.spacing));
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
