// The largest time step with which the explicit integrator is stable.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Upper bound on omega^2, the largest eigenvalue of M^-1 K of the unpinned particles at rest: 2 max_i
/// lambda_max( sum_j k_ij r r^T / m_i ), where r is the unit direction of the spring between i and j, and the
/// sum is a 3x3 matrix over all springs at i. The bound follows from (r.(u_i - u_j))^2 <= 2 (r.u_i)^2 + 2
/// (r.u_j)^2. A spring whose length d at rest exceeds its rest length l adds k (1 - l/d) (I - r r^T) to the
/// sum. A tool's spring, whose other end is fixed, adds k I to twice the sum. The result is 0 if nothing
/// oscillates.
double frequency_bound_squared(const Problem& problem);

/// The value of omega^2 (the square of the largest frequency), or why it is not known.
struct Frequency {
    std::optional<double> squared;
    std::string reason;  ///< why `squared` is absent
};

/// omega^2 itself, computed by Lanczos' iteration: the largest eigenvalue of M^-1/2 K M^-1/2 of the unpinned
/// particles. K is the stiffness matrix of small displacements about the state in which particles are
/// displaced from rest by `displacement` (one element per particle; empty: by zero). A spring of length d
/// adds k r r^T + k (1 - l/d) (I - r r^T) to K, which is the derivative of spring.h's force. That force
/// pushes if the spring is shorter than its rest length. The result is 0 if nothing oscillates.
///
/// The relative error is about 1e-8: the residual is below 1e-6 of omega^2, and the error is proportional to
/// the square of the residual over the distance to the next eigenvalue. If the two largest eigenvalues are
/// closer together than the residual, the result may be the second largest. Every call gives the same bits. A
/// heart of 30000 particles takes a tenth of a second, one of 250000 about three seconds. For more than
/// 300000 particles, and if the iteration does not converge, Frequency::squared is absent.
Frequency true_frequency_squared(const Problem& problem, const std::vector<glm::dvec3>& displacement = {});

/// The largest stable time step for a given omega^2: omega dt < 2 sqrt(1 - lambda / 2) with the damping
/// lambda in [0, 2). At the limit z^2 - (2 - lambda - omega^2 dt^2) z + 1 - lambda = 0 has the root -1. The
/// result is infinite if nothing oscillates.
double stable_time_step(double frequency_squared, double damping);

/// The stable time step for frequency_bound_squared(), which is safe for small displacements about rest. If
/// springs are stretched to twice their length, the true limit may fall to 0.7 of this time step.
double stable_time_step(const Problem& problem);

}  // namespace voxspring
