#include "harness/stability.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <unordered_set>
#include <vector>

#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

Eigen::Matrix3d outer_product(const glm::dvec3& r) {
    const Eigen::Vector3d column(r.x, r.y, r.z);
    return column * column.transpose();
}

double largest_eigenvalue(const Eigen::Matrix3d& symmetric) {
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(symmetric, Eigen::EigenvaluesOnly)
        .eigenvalues()
        .maxCoeff();
}

/// For each particle the matrix sum_j k_ij r r^T of its springs beyond the lattice; empty if there are none.
std::vector<Eigen::Matrix3d> beyond_lattice(const Problem& problem) {
    std::vector<Eigen::Matrix3d> sum;
    if (problem.springs.empty()) return sum;
    sum.assign(problem.particle_count(), Eigen::Matrix3d::Zero());
    for (const Spring& spring : problem.springs) {
        const glm::dvec3 offset = problem.rest_position[spring.first] - problem.rest_position[spring.second];
        const double length = glm::length(offset);
        Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();  // of a spring without a direction
        if (length > 0) {
            const Eigen::Matrix3d along = outer_product(offset / length);
            const double transverse = std::max(0.0, 1 - spring.rest_length / length);
            matrix = along + transverse * (Eigen::Matrix3d::Identity() - along);
        }
        sum[spring.first] += spring.stiffness * matrix;
        sum[spring.second] += spring.stiffness * matrix;
    }
    return sum;
}

}  // namespace

double frequency_bound_squared(const Problem& problem) {
    std::array<Eigen::Matrix3d, neighbour_count> along;
    for (const Direction& direction : directions()) {
        along[std::size_t(direction.bit)] =
            outer_product(glm::normalize(glm::dvec3(direction.offset) * problem.lattice.spacing));
    }
    const std::vector<Eigen::Matrix3d> beyond = beyond_lattice(problem);
    // Which particle a neighbour is matters only where materials differ.
    const std::vector<std::uint32_t> particle =
        problem.has_materials() ? particle_of_voxel(problem.lattice) : std::vector<std::uint32_t>{};
    std::unordered_set<std::uint32_t> seen;  // masks, which decide the matrix where nothing else differs
    const bool by_mask = !problem.has_materials() && beyond.empty();

    double largest = 0;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (problem.is_pinned(i)) continue;
        const std::uint32_t mask = problem.lattice.mask.empty() ? 0 : problem.lattice.mask[i];
        if (by_mask && !seen.insert(mask).second) continue;
        Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
        if (!beyond.empty()) sum = beyond[i];
        for (const Direction& direction : directions()) {
            if ((mask >> direction.bit & 1u) == 0) continue;
            std::size_t neighbour = i;
            if (problem.has_materials()) {
                neighbour =
                    particle[std::size_t(problem.lattice.voxel[i] + problem.lattice.stride(direction))];
            }
            sum += problem.spring_stiffness(i, neighbour, direction) * along[std::size_t(direction.bit)];
        }
        sum /= problem.material_of(i).mass;
        // No eigenvalue exceeds the largest row sum, so most particles need no solver.
        if (sum.cwiseAbs().rowwise().sum().maxCoeff() > largest)
            largest = std::max(largest, largest_eigenvalue(sum));
    }
    return 2 * largest;
}

double stable_time_step(const Problem& problem) {
    const double squared = frequency_bound_squared(problem);
    if (squared == 0) return std::numeric_limits<double>::infinity();
    return 2 / std::sqrt(squared) * std::sqrt(1 - problem.damping / 2);
}

}  // namespace voxspring
