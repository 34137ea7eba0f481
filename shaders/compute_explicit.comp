// Each invocation steps one particle. Lists have the particle's neighbours (lists.glsl).
//
// With SECONDARY each spring has its stiffness and rest length, and a particle's bits count all of its
// springs. Otherwise each group of springs (to face, edge or corner neighbours) has one stiffness and one
// rest length, and the bits count the springs of each group. FACES, EDGES and CORNERS say which groups the
// scene has or, with ALL_GROUPS, may have. OFF_LATTICE_REST says that the scene has, or had before an edit,
// springs that are not of the lattice and that the formulation needs to know how they lie at rest.
//
// Every list has the same number of slots. An unused slot holds the particle itself, which exerts no force on
// itself. So lists can be read in whole chunks, before it is known how many slots are used.
#ifdef ADDRESSED
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif
#include "compute.glsl"

#ifdef VULKAN
layout(local_size_x_id = 0) in;
layout(constant_id = 12) const bool SECONDARY = false;
layout(constant_id = 13) const bool OFF_LATTICE_REST = false;
layout(constant_id = 14) const bool ALL_GROUPS = false;
#else
layout(local_size_x = BLOCK) in;
#endif

#define LIST_ACCESS readonly
#include "lists.glsl"

UNIFORMS(ExplicitUniforms, 19)
UNIFORM int particles;
UNIFORM int slot_stride;
// X_j - X_i (X: position at rest) and the rest deficit of a lattice spring, by direction code. Not used with
// ON_POSITIONS.
UNIFORM Vec4 rest[32];
// For lists without SECONDARY, per group: the first slot, and 1 if the scene has the group, otherwise 0.
UNIFORM int first_slot[3];
UNIFORM int slots[3];
UNIFORM Real rest_length[3];
UNIFORM Real group_stiffness[3];
END_UNIFORMS

const int chunk = 6;

Vec4 listed_pull(Point here, Place at, Real spring_length) {
    uint entry = LISTED(neighbours, at);
#ifdef ON_POSITIONS
    int index = int(entry);
    Vec4 at_rest = Vec4(0);
#else
    int index = int(entry & LISTED_INDEX);
    uint direction = entry >> LISTED_INDEX_BITS;
    Vec4 at_rest = rest[direction];
    if (OFF_LATTICE_REST && direction == OWN_DIRECTION) at_rest = LISTED(off_lattice_rests, at);
#endif
    return unit_pull(between(here, point_of(index)), at_rest, spring_length);
}

// How many springs of `group` a particle has: one of three counters in its `bits`, of 3, 4 and 4 bits.
uint count_of(uint bits, const int group) {
    return group == 0 ? bits & 7u : group == 1 ? bits >> 3 & 15u : bits >> 7 & 15u;
}

// Sum of a particle's spring forces of `group`. A particle has at most `most` springs of the group.
Vec3 pull_of_group(Point here, int i, uint bits, const int group, const int most) {
    precise Vec3 sum = Vec3(0);
    Place at = PLACE(i, first_slot[group]);
    for (int s = 0; s < chunk; ++s)
        sum = with_pull(listed_pull(here, SLOTS_BEHIND(at, s), rest_length[group]), sum);
    if (most > chunk && count_of(bits, group) > uint(chunk)) {
        for (int s = chunk; s < most; ++s)
            sum = with_pull(listed_pull(here, SLOTS_BEHIND(at, s), rest_length[group]), sum);
    }
    precise Vec3 force = sum * group_stiffness[group];
    return force;
}

void main() {
    int group = int(gl_WorkGroupID.x + gl_NumWorkGroups.x * gl_WorkGroupID.y);
    int i = group * int(gl_WorkGroupSize.x) + int(gl_LocalInvocationIndex);
    if (i >= particles) return;
    Vec4 self = WORD(i);
    uint bits = BITS_OF(self.w);
    Vec3 before = before_of(i);
    Vec3 low = Vec3(0);
#ifdef COMPENSATED
    low = WORD_LOW(i).xyz;
#endif
    Point here = Point(self.xyz, low);
    precise Vec3 force = Vec3(0);
    if (SECONDARY) {
        uint count = bits & NEIGHBOUR_BITS;
        for (uint first = 0u; first < count; first += uint(chunk)) {
            for (int s = 0; s < chunk; ++s) {
                Place at = PLACE(i, int(first) + s);
                Vec2 own = LISTED(constants, at);
                precise Vec4 pull = listed_pull(here, at, own.y);
                pull.w *= own.x;
                force = with_pull(pull, force);
            }
        }
    } else {
#define ADD(name, group, most) \
    if (name && (!ALL_GROUPS || slots[group] > 0)) force += pull_of_group(here, i, bits, group, most);
        ADD(FACES, 0, 6)
        ADD(EDGES, 1, 12)
        ADD(CORNERS, 2, 8)
    }
    integrate_and_store(i, here, bits, before, force);
}
