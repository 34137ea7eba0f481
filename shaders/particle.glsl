// What a fragment does for its particle however it finds the neighbours: read, integrate, write.
//
// DAMPING, GRAVITY, PINS, LOADS and MATERIALS are defined where the scene has them.
#include "neighbours.h"
#include "spring.h"

// Stencil before shader: a masked texel costs no invocation.
layout(early_fragment_tests) in;

// xyz: position; w: the particle's bits (neighbours.h).
layout(binding = 0) uniform sampler2D position;
layout(binding = 1) uniform sampler2D previous_position;
// xyz: force.
layout(binding = 2) uniform sampler2D load;
// x: compliance, 1 / stiffness; y: 1 / mass.
layout(binding = 3) uniform sampler2D material;

// What the scene lacks is a constant that the compiler folds away.
#ifdef DAMPING
uniform float retained;
#else
const float retained = 1.0;
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

layout(location = 0) out vec4 next;

// Writes x(t + dt) of the particle whose texel at t is `here`, under the sum of its spring forces.
void advance(ivec2 texel, vec4 here, vec3 spring_force_sum) {
    precise vec3 force = spring_force_sum;
    vec3 previous = texelFetch(previous_position, texel, 0).xyz;
#ifdef LOADS
    force += texelFetch(load, texel, 0).xyz;
#endif
    // Everything here is `precise`: a compiler may else fuse one multiply-add where a term is compiled in and
    // another where it is left out, and skipping would change bits.
    precise vec3 moved =
        next_position(here.xyz, previous, force, INVERSE_MASS(texel), gravity, retained, time_step_squared);
#ifdef PINS
    if ((floatBitsToUint(here.w) & PINNED_BIT) != 0u) moved = here.xyz;
#endif
    next = vec4(moved, here.w);
}
