// Checks a problem that another program built, since no parser has done so, and makes a scene from it.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/common.hpp>
#include <glm/vec3.hpp>
#include <glm/vector_relational.hpp>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "backends/layout/boxes.h"
#include "backends/physics/neighbours.h"
#include "harness/base/json.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"
#include "harness/volume/dataset.h"

namespace voxspring {
namespace {

void require(bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(std::string("not a scene: ") + what);
}

bool is_positive(double number) { return std::isfinite(number) && number > 0; }

void check_lattice(const Lattice& lattice, std::size_t particles) {
    if (lattice.dims == glm::ivec3(0)) {
        require(lattice.voxel.empty() && lattice.mask.empty(), "it has voxels or masks, but dims of 0");
        return;
    }
    require(lattice.dims.x > 0 && lattice.dims.y > 0 && lattice.dims.z > 0, "dims are not positive");
    // Indices of voxels have 32 bits. The bound of the sides keeps the product of the three within 64 bits.
    require(std::max({lattice.dims.x, lattice.dims.y, lattice.dims.z}) <= max_side &&
                lattice.voxel_count() <= std::numeric_limits<std::uint32_t>::max(),
            "dims are above 1048576, or have more voxels than a 32-bit index can number");
    require(
        is_positive(lattice.spacing.x) && is_positive(lattice.spacing.y) && is_positive(lattice.spacing.z),
        "the spacing is not positive");
    require(lattice.voxel.size() == particles, "voxel must have one element per particle");
    require(lattice.mask.size() == particles, "mask must have one element per particle");
    require(std::adjacent_find(lattice.voxel.begin(), lattice.voxel.end(), std::greater_equal<>()) ==
                lattice.voxel.end(),
            "the indices in voxel are not in strictly ascending order");
    require(lattice.voxel.back() < lattice.voxel_count(), "a voxel is outside of its grid");
}

/// Checks that particles lie as their voxels do. Some formulations step rest positions, others the offsets of
/// voxels. The body may be anywhere in space.
void check_places(const Problem& problem) {
    const Lattice& lattice = problem.lattice;
    constexpr double rounding = 1e-6;  // of positions that a program has computed, in voxels
    for (std::size_t i = 0; i < lattice.voxel.size(); ++i) {
        const glm::ivec3 voxels =
            lattice.coordinates(lattice.voxel[i]) - lattice.coordinates(lattice.voxel.front());
        const glm::dvec3 apart = (problem.rest_position[i] - problem.rest_position.front()) / lattice.spacing;
        require(glm::all(glm::lessThanEqual(glm::abs(apart - glm::dvec3(voxels)), glm::dvec3(rounding))),
                "a rest position is not that of its voxel");
    }
}

/// Checks every mask bit: backends read the neighbour that a bit stands for without checking that it exists.
void check_masks(const Problem& problem) {
    const Lattice& lattice = problem.lattice;
    if (lattice.mask.empty()) return;
    require((problem.group_bits & ~NEIGHBOUR_BITS) == 0, "group_bits has bits that are no neighbour bits");
    const std::vector<std::uint32_t> particle = particle_of_voxel(lattice);
    for (std::size_t i = 0; i < lattice.mask.size(); ++i) {
        const std::uint32_t mask = lattice.mask[i];
        require((mask & ACTIVE_BIT) != 0, "a mask is without the active bit");
        require(((mask & PINNED_BIT) != 0) == problem.is_pinned(i),
                "a mask's pinned bit differs from `pinned`: call pin() to set both");
        require((mask & ~(problem.group_bits | ACTIVE_BIT | PINNED_BIT)) == 0,
                "a mask has a bit that belongs to none of the problem's spring groups (group_bits)");
        const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
        visit_directions(mask, [&](const Direction& direction) {
            require(layout::has_voxel(lattice.dims, at + direction.offset),
                    "a mask has a neighbour outside of its grid");
            const std::uint32_t j =
                particle[std::size_t(std::ptrdiff_t(lattice.voxel[i]) + lattice.stride(direction))];
            require(j != no_particle, "a mask has a neighbour where there is no particle");
            require((lattice.mask[j] >> (direction.bit ^ 1) & 1U) != 0,
                    "a spring is in the mask of one of its ends only");
        });
    }
    for (const Direction& direction : directions()) {
        if ((problem.group_bits >> direction.bit & 1U) == 0) continue;
        const double length = problem.rest_length[std::size_t(direction.bit)];
        require(std::isfinite(length) && length >= 0, "a direction's rest length is negative or not finite");
        require(length == problem.rest_length[std::size_t(direction.bit & ~1)],
                "a direction's rest length differs from that of the opposite direction");
        require(problem.has_materials() || is_positive(problem.group_stiffness[std::size_t(direction.group)]),
                "a spring group's stiffness is not positive");
    }
}

bool are_finite(const std::vector<glm::dvec3>& list) {
    return std::all_of(list.begin(), list.end(), [](const glm::dvec3& v) {
        return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
    });
}

void check_tool(const Problem& problem) {
    if (!problem.has_tool()) return;
    const auto& held = problem.tool.particles;
    require(std::adjacent_find(held.begin(), held.end(), std::greater_equal<>()) == held.end(),
            "the tool's particles are not in strictly ascending order");
    require(held.back() < problem.particle_count(),
            "the tool holds a particle that the problem does not have");
    require(problem.tool.held.empty() || problem.tool.held.size() == held.size(),
            "the tool's `held` must be empty or have one element per held particle");
    require(are_finite(problem.tool.held), "the tool's `held` is not finite");
    require(is_positive(problem.tool.stiffness), "the tool's stiffness is not positive");
    require(problem.load.size() == problem.particle_count(),
            "a problem with a tool needs loads: call take_hold()");
}

void check(const Problem& problem) {
    const std::size_t particles = problem.particle_count();
    const auto fits = [&](const auto& array) { return array.empty() || array.size() == particles; };
    require(particles > 0 && particles < no_particle, "it has no particles, or too many");
    require(fits(problem.material), "material must be empty or have one element per particle");
    require(fits(problem.pinned), "pinned must be empty or have one element per particle");
    require(fits(problem.load), "load must be empty or have one element per particle");
    require(!problem.materials.empty(), "it has no material");
    for (const Material& material : problem.materials) {
        require(is_positive(material.mass) && is_positive(material.stiffness),
                "a mass or a stiffness is not positive");
    }
    for (const std::uint8_t material : problem.material)
        require(material < problem.materials.size(), "a particle's material is not an index into materials");
    for (const Spring& spring : problem.springs) {
        require(spring.first < spring.second && spring.second < particles,
                "a spring's ends are not two particles, the smaller first");
        require(is_positive(spring.stiffness), "a spring's stiffness is not positive");
        require(std::isfinite(spring.rest_length) && spring.rest_length >= 0,
                "a spring's rest length is negative or not finite");
    }
    check_tool(problem);
    require(problem.damping >= 0 && problem.damping < 2, "damping is not in [0, 2)");
    require(are_finite(problem.rest_position), "a rest position is not finite");
    require(are_finite(problem.load), "a load is not finite");
    require(are_finite({problem.gravity}), "gravity is not finite");
    require(std::all_of(problem.pinned.begin(), problem.pinned.end(), [](std::uint8_t p) { return p <= 1; }),
            "pinned is neither 0 nor 1");
    check_lattice(problem.lattice, particles);
    check_places(problem);
    check_masks(problem);
}

}  // namespace

Scene scene_of(const std::string& name, Problem problem, State state) {
    require(!name.empty() && name.find_first_of("/ \t\n") == std::string::npos,
            "its name is empty or has a '/' or a blank");
    check(problem);
    Scene scene;
    scene.name = utf8_text(name);
    scene.problem = std::move(problem);
    scene.stable_time_step = stable_time_step(scene.problem);
    double& time_step = scene.problem.time_step;
    if (time_step == 0) time_step = scene.stable_time_step / 2;
    require(is_positive(time_step),
            "its time step is not positive, or it is 0 (for half of the stable one) and nothing limits it");
    scene.state = std::move(state);
    const auto fits = [&](const std::vector<glm::dvec3>& list) {
        return list.empty() || list.size() == scene.problem.particle_count();
    };
    require(fits(scene.state.displacement), "displacement must have one element per particle");
    require(fits(scene.state.increment), "increment must have one element per particle");
    require(are_finite(scene.state.displacement), "a displacement is not finite");
    require(are_finite(scene.state.increment), "an increment is not finite");
    return scene;
}

}  // namespace voxspring
