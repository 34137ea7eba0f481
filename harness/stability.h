// How large a time step the explicit integrator bears.
#pragma once

#include "backends/physics/problem.h"

namespace voxspring {

/// Upper bound on omega^2, the largest eigenvalue of M^-1 K of the unpinned particles at rest:
/// 2 max_i lambda_max( sum_j k_ij r r^T / m_i ), r the unit direction of the spring between i and j, the sum
/// a 3x3 matrix over all springs at i. Follows from (r.(u_i - u_j))^2 <= 2 (r.u_i)^2 + 2 (r.u_j)^2. A spring
/// that is longer at rest than its rest length l < d adds k (1 - l/d) (I - r r^T). 0 if nothing oscillates.
double frequency_bound_squared(const Problem& problem);

/// The largest stable time step for small displacements about rest, (2 / omega) sqrt(1 - lambda / 2) with
/// the damping lambda in [0, 2); infinite if nothing oscillates. Springs stretched to twice their length
/// lower the limit to as little as 0.7 of it.
double stable_time_step(const Problem& problem);

}  // namespace voxspring
