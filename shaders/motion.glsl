// What a step does to a particle however its shader finds it and its neighbours: the scene's terms, and the
// integrators.
//
// DAMPING, GRAVITY, PINS, LOADS and MATERIALS are defined where the scene has them, DEFICITS where lattice
// springs are stressed at rest and the formulation asks for it. A formulation
// (formulation.h) is ON_POSITIONS, BY_INCREMENTS or neither; PAPER and COMPENSATED are one each.
//
// Everything here and in what includes it is `precise`: a compiler may else fuse one multiply-add where a
// term is compiled in and another where it is left out, and skipping would change bits.
#include "neighbours.h"
#include "spring.h"

// What the scene lacks is a constant that the compiler folds away.
#ifdef DAMPING
uniform float damping;
uniform float retained;  // 1 - damping
uniform float doubled;   // 2 - damping
#else
const float damping = 0.0;
const float retained = 1.0;
const float doubled = 2.0;
#endif
#ifdef GRAVITY
uniform vec3 gravity;
#else
const vec3 gravity = vec3(0);
#endif
uniform float time_step_squared;
uniform float shortest_squared;

uniform vec3 spacing;

// A particle as its formulation has it: x or u, what that was before or the increment v, and what float32
// leaves of either.
struct Motion {
    vec3 here, before;
    vec3 here_low, before_low;
};

bool is_pinned(uint bits) {
#ifdef PINS
    return (bits & PINNED_BIT) != 0u;
#else
    return false;
#endif
}

// The same at t + dt, but for `before` where that is not an increment: it is then `here` of now.
Motion integrate(Motion now, vec3 force, float inverse_mass, bool pinned) {
    Motion next = now;
#ifdef BY_INCREMENTS
#ifdef DAMPING
    precise vec3 change =
        increment_change(now.before, force, inverse_mass, gravity, damping, time_step_squared);
#else
    // Without damping the increment's own term is zero. A literal zero says so, because a compiler may not
    // fold a product with zero that is `precise`.
    precise vec3 change = increment_change(vec3(0), force, inverse_mass, gravity, 0.0, time_step_squared);
#endif
#ifdef COMPENSATED
    precise vec3 faster = pinned ? vec3(0) : split_high(now.before, now.before_low, change, vec3(0));
    precise vec3 faster_low = pinned ? vec3(0) : split_low(now.before, now.before_low, change, vec3(0));
    next.here = split_high(now.here, now.here_low, faster, faster_low);
    next.here_low = split_low(now.here, now.here_low, faster, faster_low);
    next.before = faster;
    next.before_low = faster_low;
#else
    precise vec3 faster = pinned ? vec3(0) : now.before + change;
    precise vec3 sum = now.here + faster;
    next.here = sum;
    next.before = faster;
#endif
#else
#ifdef PAPER
    precise vec3 sum = paper_position(now.here, now.before, force, inverse_mass, gravity, doubled, retained,
                                      time_step_squared);
#else
    precise vec3 sum =
        next_position(now.here, now.before, force, inverse_mass, gravity, retained, time_step_squared);
#endif
    next.here = pinned ? now.here : sum;
#endif
    return next;
}
