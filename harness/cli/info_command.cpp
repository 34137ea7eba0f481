#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <iomanip>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <sstream>
#include <string>

#include "backends/registry.h"
#include "harness/base/progress.h"
#include "harness/cli/commands.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"

namespace voxspring {
namespace {

std::string bytes_text(std::uint64_t bytes) {
    std::ostringstream text;
    text << std::fixed << std::setprecision(1) << double(bytes) / (1 << 20) << " MiB";
    return text.str();
}

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
        {"bytes", facts.bytes},
    };
}

template <class Value>
void row(std::ostream& out, const std::string& name, const Value& value) {
    out << std::left << std::setw(18) << name << value << "\n";
}

template <class Vector>
std::string triple(const Vector& v) {
    std::ostringstream text;
    text << v.x << " x " << v.y << " x " << v.z;
    return text.str();
}

void print_body(const SceneFacts& facts, std::ostream& out) {
    const Scene& scene = facts.scene;
    const Problem& problem = scene.problem;
    row(out, "scene", scene.name);
    if (!scene.description.empty()) row(out, "", scene.description);
    row(out, "dims", triple(problem.lattice.dims));
    row(out, "spacing", triple(problem.lattice.spacing));
    row(out, "voxels", problem.lattice.voxel_count());
    row(out, "active particles", problem.particle_count());
    row(out, "pinned particles", facts.pinned);
    row(out, "materials", problem.materials.size());
    std::ostringstream counts;
    counts << facts.springs.total() << " (face " << facts.springs.group[0] << ", edge "
           << facts.springs.group[1] << ", corner " << facts.springs.group[2] << ")";
    row(out, "springs", counts.str());
    row(out, "damping", problem.damping);
    if (!scene.edits.empty()) {
        std::ostringstream edits;
        edits << scene.edits.size() << ", the last after step " << scene.edits.back().step;
        row(out, "edits", edits.str());
    }
}

void print_time_step(const SceneFacts& facts, std::ostream& out) {
    const Scene& scene = facts.scene;
    const double time_step = scene.problem.time_step;
    std::ostringstream step;
    step << time_step << " (" << std::setprecision(3) << 100 * time_step / scene.stable_time_step
         << "% of the stable " << std::setprecision(6) << scene.stable_time_step << ")";
    row(out, "time step", step.str());
    std::ostringstream undamped;
    undamped << facts.undamped << " would be stable";
    row(out, "  undamped", undamped.str());
    std::ostringstream limit;
    if (facts.limit) {
        limit << *facts.limit << " by Lanczos' iteration, of which the stable one is " << std::setprecision(4)
              << 100 * scene.stable_time_step / *facts.limit << "%";
    } else {
        limit << "unknown: " << facts.limit_unknown;
    }
    row(out, "  limit", limit.str());
}

void print_memory(const SceneFacts& facts, std::ostream& out) {
    out << "memory\n";
    for (const auto& [name, bytes] : facts.bytes) {
        out << "  " << std::left << std::setw(26) << name << std::right << std::setw(12) << bytes_text(bytes)
            << "\n";
    }
}

}  // namespace

void describe_scene(const std::string& argument, const VolumeOptions& volume, bool json, std::ostream& out) {
    const SceneFacts facts = facts_of(argument, volume);
    if (json) {
        out << to_json(facts).dump(2) << "\n";
        return;
    }
    print_body(facts, out);
    print_time_step(facts, out);
    print_memory(facts, out);
}

}  // namespace voxspring
