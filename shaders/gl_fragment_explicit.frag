// Each fragment steps one particle. A neighbour takes at least two fetches: its entry in the particle's list,
// and its texel.
//
// With PER_SPRING each spring has its stiffness and rest length, and a particle's bits count all neighbours.
// Otherwise each group of springs (to face, edge or corner neighbours) has one stiffness and one rest length,
// and the bits count the neighbours of each group in COUNT_BITS bits. FACES, EDGES and CORNERS say which
// groups the scene has. OFF_LATTICE_REST is defined if the scene has springs that are not of the lattice (or
// with terms=all) and the formulation needs to know how they lie at rest. A row of texels has 1 << WIDTH_BITS
// particles.
#include "measured.glsl"
#include "particle.glsl"

// Layer k: each particle's neighbour k, a list entry as in neighbours.h.
layout(binding = 6) uniform usampler2DArray neighbour;
// Layer k: stiffness and rest length of each particle's spring k. The length is squared unless BY_INCREMENTS.
layout(binding = 7) uniform sampler2DArray spring;
// Layer k: X_j - X_i (X: position at rest) and the rest deficit, if entry k has the code OWN_DIRECTION.
layout(binding = 8) uniform sampler2DArray off_lattice_rest;

uniform float rest_length[3];
uniform float group_stiffness[3];

// Packs offset + 1 of each direction into two bits per axis: the first 16 directions into one vector of
// numbers, the others into a second one. Shifts are cheaper than a table from which each fragment reads a
// different element.
#define PACK_FIRST(bit, dx, dy, dz) | (bit < 16 ? uvec3(ivec3(dx, dy, dz) + 1) << (2 * bit & 31) : uvec3(0))
#define PACK_OTHER(bit, dx, dy, dz) | (bit < 16 ? uvec3(0) : uvec3(ivec3(dx, dy, dz) + 1) << (2 * bit & 31))
#define PACK(part) uvec3(0) FACE_NEIGHBOURS(part) EDGE_NEIGHBOURS(part) CORNER_NEIGHBOURS(part)

ivec3 offset_of(uint direction) {
    uvec3 offsets = direction < 16u ? PACK(PACK_FIRST) : PACK(PACK_OTHER);
    return ivec3(offsets >> (2u * direction & 31u) & 3u) - 1;
}

vec4 listed_pull(Particle particle, uint k, float spring_length) {
    uint entry = texelFetch(neighbour, ivec3(particle.texel, k), 0).x;
    uint index = entry & LISTED_INDEX;
    uint direction = entry >> LISTED_INDEX_BITS;
    ivec2 there = ivec2(index & ((1u << WIDTH_BITS) - 1u), index >> WIDTH_BITS);
#ifdef OFF_LATTICE_REST
    if (direction == OWN_DIRECTION)
        return pull_of(particle, there, texelFetch(off_lattice_rest, ivec3(particle.texel, k), 0),
                       spring_length);
#endif
    return pull_of(particle, there, vec4(vec3(offset_of(direction)) * spacing, DEFICIT(direction)),
                   spring_length);
}

// Adds the spring to `force`. Each spring is scaled separately, so that springs with their own stiffness
// change no bit of the others.
vec3 with_listed(Particle particle, uint k, float spring_length, float stiffness, vec3 force) {
    precise vec4 pull = listed_pull(particle, k, spring_length);
    pull.w *= stiffness;
    return with_pull(pull, force);
}

void main() {
    Particle particle = own_particle();
    uint bits = bits_of(particle);
    precise vec3 force = vec3(0);
    uint k = 0u;
#ifdef PER_SPRING
    for (uint end = bits & NEIGHBOUR_BITS; k < end; ++k) {
        vec2 own = texelFetch(spring, ivec3(particle.texel, k), 0).xy;
#ifndef BY_INCREMENTS
        own.y = measured_or_zero(own.y);
#endif
        force = with_listed(particle, k, own.y, own.x, force);
    }
#else
    uint end = 0u;
#define ADD(group)                                                   \
    end += bits >> (COUNT_BITS * group) & ((1u << COUNT_BITS) - 1u); \
    for (; k < end; ++k) force = with_listed(particle, k, rest_length[group], group_stiffness[group], force);
    if (FACES) {
        ADD(0)
    }
    if (EDGES) {
        ADD(1)
    }
    if (CORNERS) {
        ADD(2)
    }
#endif
    integrate_and_store(particle, force);
}
