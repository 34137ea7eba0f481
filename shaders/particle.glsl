// What a fragment does for its particle however it finds the neighbours: read, pull, integrate, write.
//
// DAMPING, GRAVITY, PINS, LOADS and MATERIALS are defined where the scene has them, DEFICITS where lattice
// springs are stressed at rest and the formulation asks for it. A formulation
// (formulation.h) is ON_POSITIONS, BY_INCREMENTS or neither; PAPER and COMPENSATED are one each.
#include "neighbours.h"
#include "spring.h"

// Stencil before shader: a masked texel costs no invocation.
layout(early_fragment_tests) in;

// xyz: x, or u = x - X; w: the particle's bits (neighbours.h).
layout(binding = 0) uniform sampler2D position;
#ifdef BY_INCREMENTS
// xyz: v = u - u_previous.
layout(binding = 1) uniform sampler2D increment;
#else
layout(binding = 1) uniform sampler2D previous_position;
#endif
#ifdef COMPENSATED
// xyz: what float32 leaves of u and v.
layout(binding = 2) uniform sampler2D position_low;
layout(binding = 3) uniform sampler2D increment_low;
#endif
// xyz: force.
layout(binding = 4) uniform sampler2D load;
// x: compliance, 1 / stiffness; y: 1 / mass.
layout(binding = 5) uniform sampler2D material;

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
#ifdef MATERIALS
#define INVERSE_MASS(texel) texelFetch(material, texel, 0).y
#else
uniform float inverse_mass;
#define INVERSE_MASS(texel) inverse_mass
#endif
uniform float time_step_squared;
uniform float shortest_squared;

uniform vec3 spacing;
#ifdef DEFICITS
uniform float rest_deficit[32];  // by direction as a list entry has it (neighbours.h)
#endif

layout(location = 0) out vec4 next;
#ifdef BY_INCREMENTS
layout(location = 1) out vec4 next_increment;
#endif
#ifdef COMPENSATED
layout(location = 2) out vec4 next_low;
layout(location = 3) out vec4 next_increment_low;
#endif

struct Particle {
    ivec2 texel;
    vec4 here;
    vec3 low;
};

// The particle of this fragment.
Particle own_particle() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 low = vec3(0);
#ifdef COMPENSATED
    low = texelFetch(position_low, texel, 0).xyz;
#endif
    return Particle(texel, texelFetch(position, texel, 0), low);
}

uint bits_of(Particle particle) { return floatBitsToUint(particle.here.w); }

// How a lattice spring lies at rest. xyz: X_i - X_j; w: rest deficit (spring.h).
vec4 rest_of(ivec3 offset, uint direction) {
#ifdef DEFICITS
    return vec4(vec3(offset) * -spacing, rest_deficit[direction]);
#else
    return vec4(vec3(offset) * -spacing, 0);
#endif
}

// Force on the particle of its spring to the one in texel `there`, which lies at rest as rest_of() says.
//
// Everything here and below is `precise`: a compiler may else fuse one multiply-add where a term is compiled
// in and another where it is left out, and skipping would change bits.
vec3 pull(Particle particle, ivec2 there, vec4 at_rest, float rest_length, float stiffness) {
    precise vec3 relative = particle.here.xyz - texelFetch(position, there, 0).xyz;
#ifdef COMPENSATED
    relative += particle.low - texelFetch(position_low, there, 0).xyz;
#endif
#ifdef BY_INCREMENTS
    return strain_force(relative, at_rest.xyz, rest_length, at_rest.w, stiffness, shortest_squared);
#elif defined(ON_POSITIONS)
    return spring_force(relative, rest_length, stiffness, shortest_squared);
#else
    precise vec3 offset = at_rest.xyz + relative;
    return spring_force(offset, rest_length, stiffness, shortest_squared);
#endif
}

// Writes the particle's state at t + dt, under the sum of its spring forces at t.
void advance(Particle particle, vec3 spring_force_sum) {
    ivec2 texel = particle.texel;
    vec3 here = particle.here.xyz;
    float bits = particle.here.w;
#ifdef PINS
    bool pinned = (bits_of(particle) & PINNED_BIT) != 0u;
#else
    const bool pinned = false;
#endif
    precise vec3 force = spring_force_sum;
#ifdef LOADS
    force += texelFetch(load, texel, 0).xyz;
#endif
#ifdef BY_INCREMENTS
    vec3 v = texelFetch(increment, texel, 0).xyz;
    precise vec3 change =
        increment_change(v, force, INVERSE_MASS(texel), gravity, damping, time_step_squared);
#ifdef COMPENSATED
    vec3 v_low = texelFetch(increment_low, texel, 0).xyz;
    precise vec3 faster = pinned ? vec3(0) : split_high(v, v_low, change, vec3(0));
    precise vec3 faster_low = pinned ? vec3(0) : split_low(v, v_low, change, vec3(0));
    next = vec4(split_high(here, particle.low, faster, faster_low), bits);
    next_low = vec4(split_low(here, particle.low, faster, faster_low), 0);
    next_increment_low = vec4(faster_low, 0);
#else
    precise vec3 faster = pinned ? vec3(0) : v + change;
    precise vec3 moved = here + faster;
    next = vec4(moved, bits);
#endif
    next_increment = vec4(faster, 0);
#else
    vec3 previous = texelFetch(previous_position, texel, 0).xyz;
#ifdef PAPER
    precise vec3 moved = next_position_as_printed(here, previous, force, INVERSE_MASS(texel), gravity,
                                                  doubled, retained, time_step_squared);
#else
    precise vec3 moved =
        next_position(here, previous, force, INVERSE_MASS(texel), gravity, retained, time_step_squared);
#endif
    next = vec4(pinned ? here : moved, bits);
#endif
}
