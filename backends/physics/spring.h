// The spring force and the integrator, written once for every language and precision.
// Rasmusson, Mosegaard and Sorensen (2008), section 2; formulation `position`.
#ifndef VOXSPRING_SPRING_H
#define VOXSPRING_SPRING_H

#include "portable.h"

#ifndef VOXSPRING_GLSL
namespace VOXSPRING_PHYSICS_NAMESPACE {
#endif

/// Force density of one spring, its force divided by its length: k (l - |d|) / |d| with d = x_i - x_j.
/// Positive where the spring pushes its ends apart; the same to the bit seen from either end.
/// `shortest_squared` keeps coincident particles finite: |d|^2 is taken to be at least that much, so the
/// force between two particles at the same place is zero instead of NaN.
SHARED(Real)
force_density(Vec3 offset, Real rest_length, Real stiffness, Real shortest_squared) {
    PRECISE Real length = sqrt(larger(dot(offset, offset), shortest_squared));
    PRECISE Real density = stiffness * (rest_length - length) / length;
    return density;
}

/// Force of one spring on the particle at x_i: k (l - |d|) d / |d| (the paper's f_ij).
SHARED(Vec3)
spring_force(Vec3 offset, Real rest_length, Real stiffness, Real shortest_squared) {
    PRECISE Vec3 force = offset * force_density(offset, rest_length, stiffness, shortest_squared);
    return force;
}

/// Stiffness of a spring between two materials: half of each spring in series, 2 / (1/k_a + 1/k_b).
SHARED_SCALAR(Real)
series_stiffness(Real compliance_a, Real compliance_b) { return Real(2) / (compliance_a + compliance_b); }

/// Verlet with ad-hoc damping, x + (1 - lambda)(x - x_previous) + (f / m + g) dt^2: the paper's
/// (2 - lambda) x - (1 - lambda) x_previous + f / m dt^2 without the bias that rounding 2 - lambda and
/// 1 - lambda apart puts on it. `retained` is 1 - lambda.
SHARED(Vec3)
next_position(Vec3 x, Vec3 previous, Vec3 force, Real inverse_mass, Vec3 gravity, Real retained,
              Real time_step_squared) {
    PRECISE Vec3 next =
        x + ((x - previous) * retained + (force * inverse_mass + gravity) * time_step_squared);
    return next;
}

#ifndef VOXSPRING_GLSL
}  // namespace voxspring
#endif
#endif
