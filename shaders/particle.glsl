// What a fragment does for its particle, however it finds the neighbours: it reads the state, adds up forces,
// integrates and writes the next state.
#include "motion.glsl"
#include "pull.glsl"

// The stencil test comes before the shader: a masked texel costs no invocation.
layout(early_fragment_tests) in;

// xyz: position x, or displacement u = x - X, where X is the position at rest; w: the particle's bits
// (neighbours.h).
layout(binding = 0) uniform sampler2D position;
#ifdef BY_INCREMENTS
// xyz: increment v = u - u_previous.
layout(binding = 1) uniform sampler2D increment;
#else
layout(binding = 1) uniform sampler2D previous_position;
#endif
#ifdef COMPENSATED
// xyz: parts of u and v beyond the precision of float32.
layout(binding = 2) uniform sampler2D position_low;
layout(binding = 3) uniform sampler2D increment_low;
#endif
// xyz: the force on the particle besides those of springs and gravity.
layout(binding = 4) uniform sampler2D load;
// x: compliance, 1 / stiffness; y: 1 / mass.
layout(binding = 5) uniform sampler2D material;

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

// unit_pull() of the spring from the particle to the one in texel `there`.
vec4 pull_of(Particle particle, ivec2 there, vec4 rest, float rest_length) {
    precise vec3 relative = particle.here.xyz - texelFetch(position, there, 0).xyz;
#ifdef COMPENSATED
    relative += particle.low - texelFetch(position_low, there, 0).xyz;
#endif
    return unit_pull(relative, rest, rest_length);
}

// Writes the particle's state at t + dt, given the sum of its spring forces at t.
void integrate_and_store(Particle particle, vec3 spring_force_sum) {
    ivec2 texel = particle.texel;
    precise vec3 force = spring_force_sum;
    if (LOADS) force += texelFetch(load, texel, 0).xyz;
#ifdef BY_INCREMENTS
    vec3 before = texelFetch(increment, texel, 0).xyz;
#else
    vec3 before = texelFetch(previous_position, texel, 0).xyz;
#endif
    vec3 before_low = vec3(0);
#ifdef COMPENSATED
    before_low = texelFetch(increment_low, texel, 0).xyz;
#endif
    Motion after =
        integrate(Motion(particle.here.xyz, before, particle.low, before_low), force,
                  MATERIALS ? texelFetch(material, texel, 0).y : inverse_mass, is_pinned(bits_of(particle)));
    next = vec4(after.here, particle.here.w);
#ifdef BY_INCREMENTS
    next_increment = vec4(after.before, 0);
#endif
#ifdef COMPENSATED
    next_low = vec4(after.here_low, 0);
    next_increment_low = vec4(after.before_low, 0);
#endif
}
