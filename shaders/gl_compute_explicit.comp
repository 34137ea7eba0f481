// Each particle is an invocation. A list has its neighbours. Lists are vertical: slot s of all particles lies
// together, and the next slot `slot_stride` behind it.
//
// With SECONDARY each spring has its own stiffness and rest length, and a particle's bits count all of its
// springs. Otherwise each group has one of either, and the bits count the springs of each group. FACES, EDGES
// and CORNERS are defined where the scene has springs of that group or, with ALL_GROUPS, may have them.
// OFF_LATTICE_REST is defined where the scene has springs beyond the lattice and the formulation asks how
// they lie at rest.
//
// Every list has the same number of slots. An unused slot holds the particle itself, whose pull on itself is
// zero. So lists can be read in whole chunks, before the counters that say where they end.
#include "compute.glsl"

layout(local_size_x = BLOCK) in;

// List entries (neighbours.h) or, by positions, indices alone.
layout(std430, binding = 8) restrict readonly buffer Neighbours { uint neighbours[]; };
// Stiffness and rest length of each spring.
layout(std430, binding = 9) restrict readonly buffer Constants { vec2 constants[]; };
// X_j - X_i and the rest deficit, where an entry says OWN_DIRECTION.
layout(std430, binding = 10) restrict readonly buffer OffLatticeRests { vec4 off_lattice_rests[]; };

uniform int particles;
uniform int slot_stride;
#ifndef ON_POSITIONS
uniform vec4 rest[32];  // the same by direction code
#endif
// Of each group, without SECONDARY. No slot: the scene has no such springs.
uniform int first_slot[3];
uniform int slots[3];
uniform float rest_length[3];
uniform float group_stiffness[3];

const int chunk = 6;

vec4 listed_pull(Point here, int at, float spring_length) {
    uint entry = neighbours[at];
#ifdef ON_POSITIONS
    int index = int(entry);
    vec4 at_rest = vec4(0);
#else
    int index = int(entry & LISTED_INDEX);
    uint direction = entry >> LISTED_INDEX_BITS;
    vec4 at_rest = rest[direction];
#ifdef OFF_LATTICE_REST
    if (direction == OWN_DIRECTION) at_rest = off_lattice_rests[at];
#endif
#endif
    return unit_pull(between(here, point_of(index)), at_rest, spring_length);
}

// Shifts and masks of the groups' counters (cuda/kernels/explicit.h).
uint count_of(uint bits, const int group) {
    return group == 0 ? bits & 7u : group == 1 ? bits >> 3 & 15u : bits >> 7 & 15u;
}

// `most`: slots of a group that there is.
vec3 pull_of_group(Point here, int i, uint bits, const int group, const int most) {
    precise vec3 sum = vec3(0);
    int at = i + first_slot[group] * slot_stride;
    for (int s = 0; s < chunk; ++s)
        sum = with_pull(listed_pull(here, at + s * slot_stride, rest_length[group]), sum);
    if (most > chunk && count_of(bits, group) > uint(chunk)) {
        for (int s = chunk; s < most; ++s)
            sum = with_pull(listed_pull(here, at + s * slot_stride, rest_length[group]), sum);
    }
    precise vec3 force = sum * group_stiffness[group];
    return force;
}

void main() {
    int group = int(gl_WorkGroupID.x + gl_NumWorkGroups.x * gl_WorkGroupID.y);
    int i = group * BLOCK + int(gl_LocalInvocationIndex);
    if (i >= particles) return;
    vec4 self = WORD(i);
    uint bits = floatBitsToUint(self.w);
    vec3 before = before_of(i);
    vec3 low = vec3(0);
#ifdef COMPENSATED
    low = WORD_LOW(i).xyz;
#endif
    Point here = Point(self.xyz, low);
    precise vec3 force = vec3(0);
#ifdef SECONDARY
    uint count = bits & NEIGHBOUR_BITS;
    for (uint first = 0u; first < count; first += uint(chunk)) {
        for (int s = 0; s < chunk; ++s) {
            int at = i + (int(first) + s) * slot_stride;
            vec2 own = constants[at];
            precise vec4 pull = listed_pull(here, at, own.y);
            pull.w *= own.x;
            force = with_pull(pull, force);
        }
    }
#else
#ifdef ALL_GROUPS
#define ADD(group, most) \
    if (slots[group] > 0) force += pull_of_group(here, i, bits, group, most);
#else
#define ADD(group, most) force += pull_of_group(here, i, bits, group, most);
#endif
#ifdef FACES
    ADD(0, 6)
#endif
#ifdef EDGES
    ADD(1, 12)
#endif
#ifdef CORNERS
    ADD(2, 8)
#endif
#endif
    integrate_and_store(i, here, bits, before, force);
}
