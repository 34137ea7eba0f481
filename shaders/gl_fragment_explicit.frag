// One fragment a particle; its neighbours' texels stand in a list, two fetches a neighbour.
//
// With PER_SPRING each spring has its own stiffness and rest length and w counts all neighbours; without,
// w counts those of each group, COUNT_BITS bits a group, and the group has them. FACES, EDGES and CORNERS
// are defined where the scene has springs of that group.
#include "particle.glsl"

// Layer k: the texel of each particle's neighbour k, x in the lower half, y in the upper.
layout(binding = 4) uniform usampler2DArray neighbour;
// Layer k: stiffness and rest length of each particle's spring k.
layout(binding = 5) uniform sampler2DArray spring;

uniform float rest_length[3];
uniform float group_stiffness[3];

vec3 offset_from_neighbour(ivec2 texel, vec3 here, uint k) {
    uint there = texelFetch(neighbour, ivec3(texel, k), 0).x;
    return here - texelFetch(position, ivec2(there & 0xFFFFu, there >> 16), 0).xyz;
}

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 here = texelFetch(position, texel, 0);
    uint bits = floatBitsToUint(here.w);
    precise vec3 force = vec3(0);
    uint k = 0u;
#ifdef PER_SPRING
    for (uint end = bits & NEIGHBOUR_BITS; k < end; ++k) {
        vec2 own = texelFetch(spring, ivec3(texel, k), 0).xy;
        force += spring_force(offset_from_neighbour(texel, here.xyz, k), own.y, own.x, shortest_squared);
    }
#else
    uint end = 0u;
#define ADD(group)                                                                           \
    end += bits >> (COUNT_BITS * group) & ((1u << COUNT_BITS) - 1u);                         \
    for (; k < end; ++k) {                                                                   \
        force += spring_force(offset_from_neighbour(texel, here.xyz, k), rest_length[group], \
                              group_stiffness[group], shortest_squared);                     \
    }
#ifdef FACES
    ADD(0)
#endif
#ifdef EDGES
    ADD(1)
#endif
#ifdef CORNERS
    ADD(2)
#endif
#endif
    advance(texel, here, force);
}
