#include "harness/scene/stability.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <random>
#include <unordered_set>
#include <utility>
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

/// The stiffness matrix of a spring of stiffness 1 along the unit vector `r`. If the spring is longer than
/// its rest length, it also acts across.
Eigen::Matrix3d matrix_of(const glm::dvec3& r, double length, double rest_length) {
    const Eigen::Matrix3d along = outer_product(r);
    const double transverse = std::max(0.0, 1 - rest_length / length);
    return along + transverse * (Eigen::Matrix3d::Identity() - along);
}

/// For each particle the sum of k_ij matrix_of(spring) over its springs beyond the lattice and its spring to
/// a tool. The caller doubles the sum. A tool's spring, whose other end is fixed, must not be doubled, so
/// only half its stiffness is added. Empty if there are no such springs.
std::vector<Eigen::Matrix3d> beyond_lattice(const Problem& problem) {
    std::vector<Eigen::Matrix3d> sum;
    if (problem.springs.empty() && !problem.has_tool()) return sum;
    sum.assign(problem.particle_count(), Eigen::Matrix3d::Zero());
    for (const std::uint32_t held : problem.tool.particles)
        sum[held] += problem.tool.stiffness / 2 * Eigen::Matrix3d::Identity();
    for (const Spring& spring : problem.springs) {
        const glm::dvec3 offset = problem.rest_position[spring.first] - problem.rest_position[spring.second];
        const double length = glm::length(offset);
        Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();  // at length 0 there is no direction
        if (length > 0) matrix = matrix_of(offset / length, length, spring.rest_length);
        sum[spring.first] += spring.stiffness * matrix;
        sum[spring.second] += spring.stiffness * matrix;
    }
    return sum;
}

/// A spring linearised for small displacements. Its stiffness is `along` for the component of u_i - u_j along
/// `direction`, and `across` for the rest.
struct LinearSpring {
    std::uint32_t first, second;
    double along, across;
    Eigen::Vector3d direction;
};

/// All springs except the tool's and those between two pinned particles. Stiffnesses are in units of
/// `stiffness`.
std::vector<LinearSpring> linear_springs(const Problem& problem, const std::vector<glm::dvec3>& displacement,
                                         double stiffness) {
    const double shortest = std::sqrt(problem.shortest_squared());
    std::vector<LinearSpring> linear;
    for (const Spring& spring : list_springs(problem)) {
        if (problem.is_pinned(spring.first) && problem.is_pinned(spring.second)) continue;
        glm::dvec3 offset = problem.rest_position[spring.first] - problem.rest_position[spring.second];
        if (!displacement.empty()) offset += displacement[spring.first] - displacement[spring.second];
        const double length = glm::length(offset);
        const double k = spring.stiffness / stiffness;
        // Below the length `shortest` the force does not depend on the spring's direction (spring.h).
        const double across = k * (1 - spring.rest_length / std::max(length, shortest));
        const glm::dvec3 r = length < shortest ? glm::dvec3(0) : offset / length;
        linear.push_back(
            {spring.first, spring.second, length < shortest ? across : k, across, {r.x, r.y, r.z}});
    }
    return linear;
}

/// The matrix M^-1/2 K M^-1/2, with zeros in the rows and columns of pinned particles.
class Oscillations {
public:
    /// `stiffness` is the unit of the stiffnesses in `springs`.
    Oscillations(const Problem& problem, std::vector<LinearSpring> springs, double stiffness)
        : springs_(std::move(springs)),
          held_(problem.tool.particles),
          tool_stiffness_(problem.tool.stiffness / stiffness),
          inverse_root_mass_(problem.particle_count()) {
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            inverse_root_mass_[Eigen::Index(i)] =
                problem.is_pinned(i) ? 0 : 1 / std::sqrt(problem.material_of(i).mass);
        }
    }

    Eigen::Index rows() const { return 3 * inverse_root_mass_.size(); }

    /// Sets the components of pinned particles to zero.
    void remove_pinned(Eigen::VectorXd& vector) const {
        for (Eigen::Index i = 0; i < inverse_root_mass_.size(); ++i) {
            if (inverse_root_mass_[i] == 0) vector.segment<3>(3 * i).setZero();
        }
    }

    void multiply(const Eigen::VectorXd& from, Eigen::VectorXd& to) const {
        const Eigen::Map<const Eigen::Matrix3Xd> in(from.data(), 3, inverse_root_mass_.size());
        Eigen::Map<Eigen::Matrix3Xd> out(to.data(), 3, inverse_root_mass_.size());
        out.setZero();
        for (const LinearSpring& spring : springs_) {
            const Eigen::Vector3d apart = in.col(spring.first) * inverse_root_mass_[spring.first] -
                                          in.col(spring.second) * inverse_root_mass_[spring.second];
            const double along = (spring.along - spring.across) * spring.direction.dot(apart);
            const Eigen::Vector3d force = spring.across * apart + along * spring.direction;
            out.col(spring.first) += force;
            out.col(spring.second) -= force;
        }
        for (const std::uint32_t i : held_) out.col(i) += tool_stiffness_ * inverse_root_mass_[i] * in.col(i);
        out *= inverse_root_mass_.asDiagonal();
    }

private:
    std::vector<LinearSpring> springs_;
    /// Particles that the tool holds by springs of stiffness tool_stiffness_.
    std::vector<std::uint32_t> held_;
    double tool_stiffness_;
    Eigen::VectorXd inverse_root_mass_;  ///< 0 for pinned particles
};

/// The start vector of the iteration. Neighbours on a lattice move against each other, as in the lattice's
/// fastest mode, which halves the number of iterations. Random numbers add some of each of the other modes.
std::vector<double> fast_start(const Problem& problem) {
    std::vector<double> start(3 * problem.particle_count());
    std::mt19937_64 generator(1);
    for (double& component : start) component = std::ldexp(double(generator() >> 11), -54);
    for (std::size_t i = 0; i < problem.lattice.voxel.size(); ++i) {
        const glm::ivec3 at = problem.lattice.coordinates(problem.lattice.voxel[i]);
        // Amounts differ along x, y and z. With equal amounts the start might be a mode of a cube that is not
        // the fastest.
        for (int axis = 0; axis < 3; ++axis)
            start[3 * i + std::size_t(axis)] += (at[axis] % 2 == 0 ? 1 : -1) * (1 + 0.1 * axis);
    }
    return start;
}

/// Lanczos' iteration ends at this relative residual, or gives up after this number of multiplications.
constexpr double max_residual = 1e-6;
constexpr int max_multiplications = 1000;
/// The largest number of particles for which the iteration is run. For many more it takes minutes.
constexpr std::size_t max_oscillators = 300'000;

/// The largest eigenvalue of the symmetric tridiagonal matrix that Lanczos' iteration has built so far, and
/// the residual of its eigenvector in the large matrix.
std::pair<double, double> largest_ritz_value(const std::vector<double>& diagonal,
                                             const std::vector<double>& beside) {
    const auto size = Eigen::Index(diagonal.size());
    const Eigen::Map<const Eigen::VectorXd> d(diagonal.data(), size), e(beside.data(), size - 1);
    Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;
    solver.computeFromTridiagonal(d, e);
    return {solver.eigenvalues()[size - 1],
            std::abs(beside.back() * solver.eigenvectors()(size - 1, size - 1))};
}

/// The largest eigenvalue of `matrix`, or nullopt if max_multiplications do not find it.
///
/// Vectors are not orthogonalised against all earlier ones, which would take four fifths of the time. In
/// exact arithmetic they are orthogonal anyway. Rounding makes them less orthogonal. This adds copies of
/// eigenvalues that were found, but no false ones, and the residual stays valid for the largest (Paige 1980).
std::optional<double> largest_eigenvalue(const Oscillations& matrix, std::vector<double> start) {
    const Eigen::Index size = matrix.rows();
    Eigen::VectorXd v = Eigen::Map<const Eigen::VectorXd>(start.data(), size);
    matrix.remove_pinned(v);
    v.normalize();
    Eigen::VectorXd before = Eigen::VectorXd::Zero(size), next(size);
    std::vector<double> diagonal, beside;
    int next_solution = 1;
    for (int multiplications = 1; multiplications <= max_multiplications; ++multiplications) {
        matrix.multiply(v, next);
        if (!beside.empty()) next -= beside.back() * before;
        diagonal.push_back(v.dot(next));
        next -= diagonal.back() * v;
        beside.push_back(next.norm());
        if (multiplications == next_solution || multiplications == max_multiplications ||
            beside.back() == 0) {
            const auto [value, residual] = largest_ritz_value(diagonal, beside);
            if (residual <= max_residual * value || beside.back() == 0) return value;
            // Solving the small matrix takes time proportional to the cube of its size, so the intervals
            // between solutions grow.
            next_solution += 1 + next_solution / 20;
        }
        before.swap(v);
        v = next / beside.back();
    }
    return std::nullopt;
}

}  // namespace

double frequency_bound_squared(const Problem& problem) {
    std::array<Eigen::Matrix3d, neighbour_count> matrix;
    for (const Direction& direction : directions()) {
        const auto bit = std::size_t(direction.bit);
        const glm::dvec3 offset = glm::dvec3(direction.offset) * problem.lattice.spacing;
        matrix[bit] = matrix_of(glm::normalize(offset), glm::length(offset), problem.rest_length[bit]);
    }
    const std::vector<Eigen::Matrix3d> beyond = beyond_lattice(problem);
    // The index of a neighbour is needed only if materials differ.
    std::optional<LatticeSprings> springs;
    if (problem.has_materials()) springs.emplace(problem);
    // The masks of the particles so far. If nothing else differs between particles, equal masks have equal
    // matrices.
    std::unordered_set<std::uint32_t> seen;
    const bool by_mask = !problem.has_materials() && beyond.empty();

    double largest = 0;
    std::optional<std::uint32_t> before;  // mask of the previous unpinned particle
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const std::uint32_t mask = problem.lattice.mask.empty() ? 0 : problem.lattice.mask[i];
        if (by_mask && mask == before) continue;
        if (problem.is_pinned(i)) continue;
        before = mask;
        if (by_mask && !seen.insert(mask).second) continue;
        Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
        if (!beyond.empty()) sum = beyond[i];
        const auto add = [&](std::size_t neighbour, const Direction& direction) {
            sum += problem.spring_stiffness(i, neighbour, direction) * matrix[std::size_t(direction.bit)];
        };
        if (springs) {
            springs->all_of(i, add);
        } else {
            visit_directions(mask, [&](const Direction& direction) { add(i, direction); });
        }
        sum /= problem.material_of(i).mass;
        // No eigenvalue exceeds the largest row sum of absolute values, so most particles need no solver.
        if (sum.cwiseAbs().rowwise().sum().maxCoeff() > largest)
            largest = std::max(largest, largest_eigenvalue(sum));
    }
    return 2 * largest;
}

Frequency true_frequency_squared(const Problem& problem, const std::vector<glm::dvec3>& displacement) {
    if (problem.particle_count() > max_oscillators) {
        return {{},
                std::to_string(problem.particle_count()) + " particles are more than the " +
                    std::to_string(max_oscillators) + " for which it is computed"};
    }
    const double bound = frequency_bound_squared(problem);
    if (bound == 0) return {0, {}};
    const Oscillations oscillations(problem, linear_springs(problem, displacement, bound), bound);
    const std::optional<double> largest = largest_eigenvalue(oscillations, fast_start(problem));
    if (!largest) {
        return {{},
                "Lanczos' iteration did not converge in " + std::to_string(max_multiplications) +
                    " multiplications"};
    }
    return {bound * std::max(0.0, *largest), {}};
}

double stable_time_step(double frequency_squared, double damping) {
    if (frequency_squared == 0) return std::numeric_limits<double>::infinity();
    return 2 / std::sqrt(frequency_squared) * std::sqrt(1 - damping / 2);
}

double stable_time_step(const Problem& problem) {
    return stable_time_step(frequency_bound_squared(problem), problem.damping);
}

}  // namespace voxspring
