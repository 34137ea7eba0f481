// The integrators, for every language and precision, and the spring force with a square root, which backends
// on the processor use. The root is IEEE 754's, except with root=refined or root=raw of cpu_parallel. GPUs
// use the spring force of inverse_root.h. The formulas are those of Rasmusson, Mosegaard and Sorensen (2008),
// section 2, in the variables of formulation.h.
#ifndef VOXSPRING_SPRING_H
#define VOXSPRING_SPRING_H

#include "portable.h"

#ifndef VOXSPRING_GLSL
namespace VOXSPRING_PHYSICS_NAMESPACE {
#endif

/// Force density of one spring, which is its force divided by its length: k (l - |d|) / |d| with `offset` d =
/// x_i - x_j. It is positive if the spring pushes its ends apart, and has the same bits seen from either end.
/// |d|^2 is taken to be at least `shortest_squared`, so the force between two particles at the same place is
/// zero instead of NaN.
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

/// force_density() by a formula that gives exactly zero at rest if rest is free of stress. `relative` is u_i
/// - u_j and `rest_offset` X_i - X_j, so d = rest_offset + relative. `rest_deficit` = l^2 - |X_i - X_j|^2 is
/// zero if rest is free of stress. Then l^2 - |d|^2 = rest_deficit - relative.(2 rest_offset + relative), and
/// l - |d| = (l^2 - |d|^2) / (l + |d|). So the formula subtracts no two nearly equal lengths.
SHARED(Real)
strain_density(Vec3 relative, Vec3 rest_offset, Real rest_length, Real rest_deficit, Real stiffness,
               Real shortest_squared) {
    PRECISE Vec3 offset = rest_offset + relative;
    PRECISE Real deficit = rest_deficit - dot(relative, rest_offset + offset);
    PRECISE Real length = sqrt(larger(dot(offset, offset), shortest_squared));
    PRECISE Real density = stiffness * deficit / ((length + rest_length) * length);
    return density;
}

/// Force of one spring on particle i, from strain_density().
SHARED(Vec3)
strain_force(Vec3 relative, Vec3 rest_offset, Real rest_length, Real rest_deficit, Real stiffness,
             Real shortest_squared) {
    PRECISE Vec3 force = (rest_offset + relative) * strain_density(relative, rest_offset, rest_length,
                                                                   rest_deficit, stiffness, shortest_squared);
    return force;
}

/// Force of a tool (problem.h) on a particle that it holds. `here` + `here_low` is the particle's position or
/// displacement, `anchor` is what it was when the tool took hold, and `moved` is how far the tool has moved
/// since then.
SHARED(Vec3)
hold_force(Vec3 anchor, Vec3 here, Vec3 here_low, Vec3 moved, Real stiffness) {
    PRECISE Vec3 force = (((anchor - here) - here_low) + moved) * stiffness;
    return force;
}

/// Stiffness of a spring between two materials a and b: half a spring of each in series, 2 / (1/k_a + 1/k_b).
/// A compliance is 1 / k.
SHARED_SCALAR(Real)
series_stiffness(Real compliance_a, Real compliance_b) { return Real(2) / (compliance_a + compliance_b); }

/// Verlet with ad-hoc damping: x + (1 - lambda)(x - x_previous) + (f / m + g) dt^2. In exact arithmetic this
/// equals the paper's (2 - lambda) x - (1 - lambda) x_previous + f / m dt^2, but it has no bias from rounding
/// 2 - lambda and 1 - lambda separately. `retained` is 1 - lambda.
SHARED(Vec3)
next_position(Vec3 x, Vec3 previous, Vec3 force, Real inverse_mass, Vec3 gravity, Real retained,
              Real time_step_squared) {
    PRECISE Vec3 next =
        x + ((x - previous) * retained + (force * inverse_mass + gravity) * time_step_squared);
    return next;
}

/// The paper's equation 4, (2 - lambda) x - (1 - lambda) x_previous + a dt^2, in the paper's order of
/// operations. The paper prints the force in place of a, for particles of unit mass without gravity; here a
/// is f / m + g. `doubled` is 2 - lambda and `retained` is 1 - lambda, each rounded separately.
SHARED(Vec3)
paper_position(Vec3 x, Vec3 previous, Vec3 force, Real inverse_mass, Vec3 gravity, Real doubled,
               Real retained, Real time_step_squared) {
    PRECISE Vec3 next =
        (x * doubled - previous * retained) + (force * inverse_mass + gravity) * time_step_squared;
    return next;
}

/// What one step adds to the increment v = x(t) - x(t - dt): (f / m + g) dt^2 - lambda v. The step then adds
/// the changed increment to the displacement.
SHARED(Vec3)
increment_change(Vec3 increment, Vec3 force, Real inverse_mass, Vec3 gravity, Real damping,
                 Real time_step_squared) {
    PRECISE Vec3 change = (force * inverse_mass + gravity) * time_step_squared - increment * damping;
    return change;
}

/// The exact rounding error of `sum` = a + b, that is, a + b minus the rounded sum (Knuth's TwoSum).
SHARED_VECTOR(Vec3)
sum_error(Vec3 a, Vec3 b, Vec3 sum) {
    PRECISE Vec3 b_taken = sum - a;
    PRECISE Vec3 a_taken = sum - b_taken;
    PRECISE Vec3 error = (a - a_taken) + (b - b_taken);
    return error;
}

/// The low part of the sum (high + low) + (added + added_low): the rest that split_high() does not represent.
/// A compiler shares the common work of the two functions.
SHARED_VECTOR(Vec3)
split_low(Vec3 high, Vec3 low, Vec3 added, Vec3 added_low) {
    PRECISE Vec3 sum = high + added;
    PRECISE Vec3 rest = sum_error(high, added, sum) + (low + added_low);
    PRECISE Vec3 renormalised = sum + rest;
    PRECISE Vec3 left = rest - (renormalised - sum);
    return left;
}

/// The high part of the sum (high + low) + (added + added_low): the sum rounded to one number.
SHARED_VECTOR(Vec3)
split_high(Vec3 high, Vec3 low, Vec3 added, Vec3 added_low) {
    PRECISE Vec3 sum = high + added;
    PRECISE Vec3 rest = sum_error(high, added, sum) + (low + added_low);
    PRECISE Vec3 renormalised = sum + rest;
    return renormalised;
}

#ifndef VOXSPRING_GLSL
}  // namespace voxspring
#endif
#endif
