// Finds the springs that cuts and sutures of a scene file change.
#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <variant>

#include "backends/layout/boxes.h"
#include "harness/scene/scene_file.h"

namespace voxspring {
namespace {

/// The largest distance in voxels that a suture by shape may span. The number of pairs of particles to test
/// grows with the cube of the distance.
constexpr int max_suture_voxels = 8;

/// One repetition of an edit, with the step after which it is made.
struct Due {
    const EditSpec* spec;
    int time;
    std::int64_t step;
};

Shape moved(Shape shape, const glm::dvec3& by) {
    if (auto* plane = std::get_if<Plane>(&shape)) plane->point += by;
    if (auto* ball = std::get_if<Ball>(&shape)) ball->centre += by;
    if (auto* patch = std::get_if<TrianglePatch>(&shape)) {
        for (auto& triangle : patch->triangles) {
            for (glm::dvec3& corner : triangle) corner += by;
        }
    }
    return shape;
}

void check_sizes(const std::vector<EditSpec>& specs, const Lattice& lattice, const SceneSizeLimits& limits) {
    const glm::dvec3& spacing = lattice.spacing;
    double work = 0;
    for (const EditSpec& spec : specs) {
        const auto* patch = spec.shape ? std::get_if<TrianglePatch>(&*spec.shape) : nullptr;
        const std::size_t triangles = patch != nullptr ? patch->triangles.size() : 1;
        work += double(spec.times) * double(lattice.voxel_count()) * double(triangles);
        if (work > limits.edit_work) {
            spec.source.refuse("fewer or smaller edits: together the edits test more than " +
                               std::to_string(std::int64_t(limits.edit_work)) +
                               " pairs of a voxel and a triangle or other shape");
        }
        if (spec.within > max_suture_voxels * std::min({spacing.x, spacing.y, spacing.z}))
            spec.source.refuse("\"within\" of at most " + std::to_string(max_suture_voxels) +
                               " times the smallest spacing");
    }
}

/// All repetitions of all edits, sorted by step. Edits after the same step keep the order of the file.
std::vector<Due> by_step(const std::vector<EditSpec>& specs) {
    std::vector<Due> all;
    for (const EditSpec& spec : specs) {
        for (int time = 0; time < spec.times; ++time)
            all.push_back({&spec, time, spec.step + std::int64_t(time) * spec.every});
    }
    std::stable_sort(all.begin(), all.end(), [](const Due& a, const Due& b) { return a.step < b.step; });
    return all;
}

/// The pairs of particles that the suture `spec` names by their voxels.
std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs_of(const EditSpec& spec, const Lattice& lattice,
                                                              const std::vector<std::uint32_t>& particle) {
    const auto particle_at = [&](const glm::ivec3& voxel) {
        const glm::ivec3 dims = lattice.dims;
        if (!layout::has_voxel(dims, voxel) || particle[layout::index_in(dims, voxel)] == no_particle)
            spec.source.refuse("pairs of active voxels in a grid of " + to_string(dims));
        return particle[layout::index_in(dims, voxel)];
    };
    std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
    for (const auto& [a, b] : spec.voxels) {
        pairs.emplace_back(particle_at(a), particle_at(b));
        if (pairs.back().first == pairs.back().second) spec.source.refuse("pairs of different voxels");
    }
    return pairs;
}

/// Makes the edit `due` on the springs as earlier edits have left them in `editor`.
SpringEdit make_edit(const Due& due, SpringEditor& editor, const Lattice& lattice,
                     const std::vector<std::uint32_t>& particle) {
    const EditSpec& spec = *due.spec;
    if (!spec.shape) return editor.suture(pairs_of(spec, lattice, particle), spec.stiffness);
    const Shape shape = moved(*spec.shape, double(due.time) * spec.move);
    return spec.suture ? editor.suture(shape, spec.within, spec.stiffness) : editor.cut(shape);
}

}  // namespace

std::vector<ScheduledEdit> schedule_edits(const std::vector<EditSpec>& specs, const Problem& problem,
                                          const SceneSizeLimits& limits) {
    check_sizes(specs, problem.lattice, limits);
    Problem edited = problem;
    SpringEditor editor(edited);
    const std::vector<std::uint32_t> particle = particle_of_voxel(problem.lattice);

    std::vector<ScheduledEdit> scheduled;
    std::vector<bool> changes(specs.size(), false);
    for (const Due& due : by_step(specs)) {
        const SpringEdit edit = make_edit(due, editor, problem.lattice, particle);
        if (edit.empty()) continue;
        changes[std::size_t(due.spec - specs.data())] = true;
        if (due.step > std::numeric_limits<int>::max())
            due.spec->source.refuse("edits and repetitions after at most 2147483647 steps");
        scheduled.push_back({int(due.step), edit});
    }
    for (std::size_t s = 0; s < specs.size(); ++s) {
        if (changes[s]) continue;
        specs[s].source.refuse(specs[s].suture ? "a suture of at least one pair that no spring joins yet"
                                               : "a cut that crosses at least one spring");
    }
    return scheduled;
}

}  // namespace voxspring
