#include "harness/scene/corners.h"

#include <algorithm>
#include <cmath>
#include <glm/vector_relational.hpp>
#include <map>
#include <numeric>
#include <stdexcept>

#include "backends/layout/boxes.h"

namespace voxspring {
namespace {

/// Calls visit(voxel) for each voxel that has both corner `at` and corner `at + offset`, and returns the
/// number of these voxels. Some of them may lie outside the grid.
template <class Visit>
int visit_voxels(glm::ivec3 at, glm::ivec3 offset, Visit visit) {
    // Voxel v has the corners v and v + 1 along each axis.
    const glm::ivec3 begin = at - glm::ivec3(glm::lessThanEqual(offset, glm::ivec3(0)));
    const glm::ivec3 end = at + 1 - glm::ivec3(glm::lessThan(offset, glm::ivec3(0)));
    layout::visit_box(begin, end, visit);
    return int(layout::volume(end - begin));
}

}  // namespace

Problem make_corner_problem(const VoxelGrid& voxels, std::uint32_t group_bits,
                            const std::vector<VoxelMaterial>& materials) {
    /// The material of a voxel; null if it is inactive or outside of the grid.
    const auto material_at = [&](const glm::ivec3& voxel) -> const VoxelMaterial* {
        if (!layout::has_voxel(voxels.dims, voxel)) return nullptr;
        const std::uint8_t label = voxels.label[layout::index_in(voxels.dims, voxel)];
        return label != 0 ? &materials[label - 1] : nullptr;
    };
    VoxelGrid corners{voxels.dims + 1, voxels.spacing, {}};
    std::map<double, std::uint8_t> label_of_mass;
    layout::visit_box(glm::ivec3(0), corners.dims, [&](glm::ivec3 corner) {
        // Sums are made in ascending order: in another order the same voxels may have another rounded sum,
        // which would count as a different mass.
        std::array<double, 8> masses{};
        auto next = masses.begin();
        visit_voxels(corner, glm::ivec3(0), [&](glm::ivec3 voxel) {
            if (const auto* material = material_at(voxel)) *next++ = material->mass / 8;
        });
        std::sort(masses.begin(), masses.end());
        const double mass = std::accumulate(masses.begin(), masses.end(), 0.0);
        std::uint8_t label = 0;
        if (mass > 0) {
            constexpr std::size_t most = 254;
            if (label_of_mass.size() == most && !label_of_mass.contains(mass))
                throw std::invalid_argument("the corners have more than 254 different masses");
            label = label_of_mass.emplace(mass, std::uint8_t(label_of_mass.size() + 1)).first->second;
        }
        corners.label.push_back(label);
    });

    Problem problem = make_lattice_problem(corners, group_bits);
    const double full = materials.front().stiffness[0];
    problem.group_stiffness = {full, full, full};
    problem.materials.assign(label_of_mass.size(), {1, full});
    for (const auto& [mass, label] : label_of_mass) problem.materials[label - 1U].mass = mass;

    const LatticeSprings lattice(problem);
    std::vector<std::uint32_t> mask = problem.lattice.mask;
    for (std::uint32_t i = 0; i < problem.particle_count(); ++i) {
        const glm::ivec3 at = problem.lattice.coordinates(problem.lattice.voxel[i]);
        lattice.of(i, [&](std::uint32_t j, const Direction& direction) {
            double sum = 0;
            const int places = visit_voxels(at, direction.offset, [&](glm::ivec3 voxel) {
                if (const auto* material = material_at(voxel))
                    sum += material->stiffness[std::size_t(direction.group)];
            });
            const double stiffness = sum / places;
            // Upper bound of the relative rounding error of a mean over up to four voxels.
            constexpr double rounding = 1e-12;
            if (std::abs(stiffness - full) <= rounding * full) return;
            mask[i] &= ~(1U << direction.bit);
            mask[j] &= ~(1U << (direction.bit ^ 1));
            if (sum > 0)
                problem.springs.push_back({i, j, stiffness, problem.rest_length[std::size_t(direction.bit)]});
        });
    }
    problem.lattice.mask = std::move(mask);
    return problem;
}

}  // namespace voxspring
