#include "harness/scene/corners.h"

#include <cmath>
#include <map>
#include <stdexcept>

namespace voxspring {
namespace {

/// The voxels around a corner or around a spring between two corners.
class VoxelsAround {
public:
    VoxelsAround(const VoxelGrid& voxels, const std::vector<VoxelMaterial>& materials)
        : voxels_(voxels), materials_(materials) {}

    /// Calls visit(material) for each active voxel that has both corner `at` and corner `at + offset`, and
    /// returns the number of places where such a voxel could be.
    template <class Visit>
    int visit(glm::ivec3 at, glm::ivec3 offset, Visit visit) const {
        int places = 0;
        // Voxel v has the corners v and v + 1 along each axis.
        const auto low = [&](int axis) { return at[axis] - (offset[axis] > 0 ? 0 : 1); };
        const auto high = [&](int axis) { return at[axis] - (offset[axis] < 0 ? 1 : 0); };
        for (int z = low(2); z <= high(2); ++z) {
            for (int y = low(1); y <= high(1); ++y) {
                for (int x = low(0); x <= high(0); ++x) {
                    ++places;
                    const std::uint8_t label = label_at({x, y, z});
                    if (label != 0) visit(materials_[label - 1]);
                }
            }
        }
        return places;
    }

private:
    std::uint8_t label_at(glm::ivec3 v) const {
        const glm::ivec3 dims = voxels_.dims;
        if (v.x < 0 || v.y < 0 || v.z < 0 || v.x >= dims.x || v.y >= dims.y || v.z >= dims.z) return 0;
        return voxels_
            .label[(std::size_t(v.z) * std::size_t(dims.y) + std::size_t(v.y)) * std::size_t(dims.x) +
                   std::size_t(v.x)];
    }

    const VoxelGrid& voxels_;
    const std::vector<VoxelMaterial>& materials_;
};

}  // namespace

Problem make_corner_problem(const VoxelGrid& voxels, std::uint32_t group_bits,
                            const std::vector<VoxelMaterial>& materials) {
    const VoxelsAround around(voxels, materials);
    VoxelGrid corners{voxels.dims + 1, voxels.spacing, {}};
    std::map<double, std::uint8_t> label_of_mass;
    for (int z = 0; z < corners.dims.z; ++z) {
        for (int y = 0; y < corners.dims.y; ++y) {
            for (int x = 0; x < corners.dims.x; ++x) {
                double mass = 0;
                around.visit({x, y, z}, glm::ivec3(0),
                             [&](const VoxelMaterial& material) { mass += material.mass / 8; });
                std::uint8_t label = 0;
                if (mass > 0) {
                    constexpr std::size_t most = 254;
                    if (label_of_mass.size() == most && !label_of_mass.contains(mass))
                        throw std::invalid_argument("the corners have more than 254 different masses");
                    label = label_of_mass.emplace(mass, std::uint8_t(label_of_mass.size() + 1)).first->second;
                }
                corners.label.push_back(label);
            }
        }
    }

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
            const int places = around.visit(at, direction.offset, [&](const VoxelMaterial& material) {
                sum += material.stiffness[std::size_t(direction.group)];
            });
            const double stiffness = sum / places;
            // Relative rounding error of a sum over up to eight springs, and of two half springs in series.
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
