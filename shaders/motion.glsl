// What a step does to a particle, however a shader finds the particle and its neighbours: the scene's terms,
// and the integrators.
//
// Terms are constants (terms.glsl), so a compiler folds away those that the scene lacks. A formulation
// (formulation.h) is ON_POSITIONS, BY_INCREMENTS or neither of these; PAPER and COMPENSATED each stand for
// one formulation.
//
// Everything here and in files that include this is `precise`. Otherwise a compiler might fuse one
// multiply-add where a term is compiled in and another where it is left out, and skipping a term would change
// bits.
#include "neighbours.h"
#include "spring.h"
#include "terms.glsl"
#include "uniforms.glsl"

UNIFORMS(MotionUniforms, 16)
UNIFORM Real damping;
UNIFORM Real retained;  // 1 - damping
UNIFORM Real doubled;   // 2 - damping
UNIFORM Vec3 gravity;
UNIFORM Real time_step_squared;
UNIFORM Real shortest_squared;
UNIFORM Vec3 spacing;
UNIFORM Real inverse_mass;  // of every particle, unless MATERIALS
END_UNIFORMS

// The motion of a particle. here: position x or displacement u, by the formulation. before: `here` of the
// previous step or, with BY_INCREMENTS, the increment v. here_low, before_low: the parts beyond the precision
// of `here` and `before`, for COMPENSATED only.
struct Motion {
    Vec3 here, before;
    Vec3 here_low, before_low;
};

bool is_pinned(uint bits) { return PINS && (bits & PINNED_BIT) != 0u; }

// Returns the motion at t + dt. Unless BY_INCREMENTS, only `here` changes, and `before` stays as it was.
Motion integrate(Motion now, Vec3 force, Real inverse_mass, bool pinned) {
    Motion next = now;
    Vec3 acceleration = GRAVITY ? gravity : Vec3(0);
#ifdef BY_INCREMENTS
    // Without damping the damping term is zero. We pass literal zeros, because the compiler may not fold a
    // `precise` product of the increment with zero.
    precise Vec3 change = increment_change(DAMPING ? now.before : Vec3(0), force, inverse_mass, acceleration,
                                           DAMPING ? damping : Real(0), time_step_squared);
#ifdef COMPENSATED
    precise Vec3 faster = pinned ? Vec3(0) : split_high(now.before, now.before_low, change, Vec3(0));
    precise Vec3 faster_low = pinned ? Vec3(0) : split_low(now.before, now.before_low, change, Vec3(0));
    next.here = split_high(now.here, now.here_low, faster, faster_low);
    next.here_low = split_low(now.here, now.here_low, faster, faster_low);
    next.before = faster;
    next.before_low = faster_low;
#else
    precise Vec3 faster = pinned ? Vec3(0) : now.before + change;
    precise Vec3 sum = now.here + faster;
    next.here = sum;
    next.before = faster;
#endif
#else
#ifdef PAPER
    precise Vec3 sum =
        paper_position(now.here, now.before, force, inverse_mass, acceleration, DAMPING ? doubled : Real(2),
                       DAMPING ? retained : Real(1), time_step_squared);
#else
    precise Vec3 sum = next_position(now.here, now.before, force, inverse_mass, acceleration,
                                     DAMPING ? retained : Real(1), time_step_squared);
#endif
    next.here = pinned ? now.here : sum;
#endif
    return next;
}
