// How large a time step the explicit integrator bears.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Upper bound on omega^2, the largest eigenvalue of M^-1 K of the unpinned particles at rest:
/// 2 max_i lambda_max( sum_j k_ij r r^T / m_i ), r the unit direction of the spring between i and j, the sum
/// a 3x3 matrix over all springs at i. Follows from (r.(u_i - u_j))^2 <= 2 (r.u_i)^2 + 2 (r.u_j)^2. A spring
/// that is longer at rest than its rest length l < d adds k (1 - l/d) (I - r r^T). A tool's spring, whose
/// other end stays, adds k I to twice the sum. 0 if nothing oscillates.
double frequency_bound_squared(const Problem& problem);

/// An omega^2, or why it is not known.
struct Frequency {
    std::optional<double> squared;
    std::string reason;  ///< where there is none
};

/// omega^2 itself by Lanczos' iteration, for small displacements about the state in which every particle is
/// `displacement` (one a particle; empty: none) away from rest: the largest eigenvalue of M^-1/2 K M^-1/2 of
/// the unpinned particles. A spring of length d adds to K k r r^T + k (1 - l/d) (I - r r^T), the derivative
/// of spring.h's force, which pushes where it is shorter than at rest; 0 if nothing oscillates.
///
/// Its relative error is some 1e-8: the residual is under 1e-6 of omega^2, and the error goes with the square
/// of the residual over the distance of the next eigenvalue; of two that lie closer together than that it may
/// be the lower. The same to the bit each time. A heart of 30000 particles takes a tenth of a second, one of
/// 250000 some three; there is none for more than 300000 particles or where the iteration does not converge.
Frequency true_frequency_squared(const Problem& problem, const std::vector<glm::dvec3>& displacement = {});

/// The largest stable time step of an omega^2: omega dt < 2 sqrt(1 - lambda / 2) with the damping lambda in
/// [0, 2), where z^2 - (2 - lambda - omega^2 dt^2) z + 1 - lambda = 0 has the root -1. Infinite if nothing
/// oscillates.
double stable_time_step(double frequency_squared, double damping);

/// That of frequency_bound_squared(): safe for small displacements about rest. Springs stretched to twice
/// their length lower the limit to as little as 0.7 of it.
double stable_time_step(const Problem& problem);

}  // namespace voxspring
