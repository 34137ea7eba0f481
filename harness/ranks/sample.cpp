#include "harness/ranks/sample.h"

#include <algorithm>
#include <utility>

namespace voxspring {
namespace {

using Brick = Decomposition::Brick;

Brick widened(const Brick& brick, int layers) { return {brick.begin - layers, brick.end + layers}; }

int longest_axis(const Problem& problem) {
    const glm::ivec3 slabs = Decomposition::slabs(problem, 2);
    return slabs.x > 1 ? 0 : slabs.y > 1 ? 1 : 2;
}

}  // namespace

std::vector<std::uint32_t> places_of(const std::vector<std::uint32_t>& some,
                                     const std::vector<std::uint32_t>& all) {
    std::vector<std::uint32_t> places;
    places.reserve(some.size());
    auto from = all.begin();
    for (const std::uint32_t value : some) {
        from = std::lower_bound(from, all.end(), value);
        places.push_back(std::uint32_t(from - all.begin()));
    }
    return places;
}

Scene part_of(const Scene& scene, Subdomain& subdomain) {
    Scene part{.name = scene.name,
               .source = scene.source,
               .description = scene.description,
               .problem = std::move(subdomain.problem),
               .state = subdomain.part_of(scene.state),
               .edits = {},
               .tool_motion = scene.tool_motion,
               .stable_time_step = scene.stable_time_step};
    for (const ScheduledEdit& scheduled : scene.edits)
        part.edits.push_back({scheduled.step, subdomain.part_of(scene.problem, scheduled.edit)});
    return part;
}

std::vector<Brick> Sample::bricks(const Scene& scene, int layers) {
    const Lattice& lattice = scene.problem.lattice;
    const int axis = longest_axis(scene.problem);
    const auto [first, last] = lattice.occupied_layers(axis);
    const int end = last + 1;
    std::vector<Brick> bricks;
    for (const int begin : {first, (first + end - layers) / 2, end - layers}) {
        Brick brick{glm::ivec3(0), lattice.dims};
        brick.begin[axis] = begin;
        brick.end[axis] = begin + layers;
        bricks.push_back(brick);
    }
    return bricks;
}

std::string Sample::refusal(const Scene& scene, int layers) {
    const Lattice& lattice = scene.problem.lattice;
    if (lattice.voxel.empty()) return "a sample is layers of a lattice, and the particles lie on no lattice";
    if (!scene.problem.springs.empty() ||
        std::any_of(scene.edits.begin(), scene.edits.end(),
                    [](const ScheduledEdit& scheduled) { return scheduled.edit.leaves_lattice(); }))
        return "the scene has springs that are not those of its lattice, and they may leave the layers of a "
               "sample";
    const int axis = longest_axis(scene.problem);
    const std::vector<Brick> all = bricks(scene, layers);
    // Each brick needs a layer of ghosts on every side that faces another brick: four layers in all.
    if (const int length = all.back().end[axis] - all.front().begin[axis]; 3 * layers + 4 > length)
        return "the sample's three parts and the layers beside them take " + std::to_string(3 * layers + 4) +
               " layers, and the body has " + std::to_string(length) +
               "; without this key the whole body is verified";
    for (const Brick& brick : all) {
        if (Decomposition::particles_in(lattice, brick).empty())
            return "a part of the sample has no particle";
    }
    return {};
}

std::vector<std::uint32_t> Sample::particles(const Problem& problem, const std::vector<Brick>& bricks) {
    std::vector<std::uint32_t> particles;
    for (const Brick& brick : bricks) {
        const std::vector<std::uint32_t> more =
            Decomposition::particles_in(problem.lattice, widened(brick, 1));
        particles.insert(particles.end(), more.begin(), more.end());
    }
    // Bricks across z follow each other in the list. Those across x or y alternate in it.
    std::sort(particles.begin(), particles.end());
    particles.erase(std::unique(particles.begin(), particles.end()), particles.end());
    return particles;
}

Sample::Sample(const Scene& scene, const Brick& brick, int steps) {
    Subdomain sample = Decomposition::alone(scene.problem, brick);
    Subdomain near = Decomposition::alone(scene.problem, widened(brick, 1 + steps));
    in_around = places_of(sample.particle, near.particle);
    judged = part_of(scene, sample);
    around = part_of(scene, near);
    particle = std::move(sample.particle);
}

}  // namespace voxspring
