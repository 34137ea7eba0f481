// One invocation a voxel: its neighbours are at fixed offsets in the grid, and its mask says which of them
// exist. FACES, EDGES and CORNERS are defined where the scene has springs of that group, ORIGINS where only
// the work groups with an active voxel are dispatched, VOTE where a subgroup whose particles all have every
// neighbour goes a way without masks, TILE where neighbours come from shared memory.
//
// Guard words before the first voxel and after the last: the neighbours of any voxel, inside the lattice or
// not, are words that may be read.
#ifdef VOTE
#extension GL_KHR_shader_subgroup_vote : require
#endif
#include "compute.glsl"

layout(local_size_x = BLOCK_X, local_size_y = BLOCK_Y, local_size_z = BLOCK_Z) in;

layout(std430, binding = 8) restrict readonly buffer Compliances { float compliances[]; };
// The voxel that each work group begins at.
layout(std430, binding = 9) restrict readonly buffer Origins { ivec4 origins[]; };

// With DIMS constants, so that the compiler knows how far away a neighbour is.
#ifdef DIMS
const ivec3 dims = DIMS;
const int first_word = FIRST_WORD;
#else
uniform ivec3 dims;
uniform int first_word;
#endif
// By mask bit / 2.
uniform float rest_length[13];
uniform float group_stiffness[3];

int word_of(ivec3 voxel) { return first_word + voxel.x + dims.x * (voxel.y + dims.y * voxel.z); }

#ifdef TILE
// The group's voxels and a frame of one around them, an array an axis, so that neighbouring invocations read
// neighbouring banks.
const ivec3 tile_dims = ivec3(BLOCK_X, BLOCK_Y, BLOCK_Z) + 2;
const int tile_cells = tile_dims.x * tile_dims.y * tile_dims.z;
shared float tile_x[tile_cells], tile_y[tile_cells], tile_z[tile_cells];
#ifdef COMPENSATED
shared float low_x[tile_cells], low_y[tile_cells], low_z[tile_cells];
#endif

int tile_cell(ivec3 at) { return at.x + tile_dims.x * (at.y + tile_dims.y * at.z); }

// What lies outside of the lattice, and one voxel around it, is left unset and belongs to no spring.
void fill_tile(ivec3 origin) {
    for (int cell = int(gl_LocalInvocationIndex); cell < tile_cells; cell += BLOCK_X * BLOCK_Y * BLOCK_Z) {
        ivec3 voxel =
            origin - 1 +
            ivec3(cell % tile_dims.x, cell / tile_dims.x % tile_dims.y, cell / (tile_dims.x * tile_dims.y));
        if (any(greaterThan(voxel, dims))) continue;
        Point there = point_of(word_of(voxel));
        tile_x[cell] = there.high.x;
        tile_y[cell] = there.high.y;
        tile_z[cell] = there.high.z;
#ifdef COMPENSATED
        low_x[cell] = there.low.x;
        low_y[cell] = there.low.y;
        low_z[cell] = there.low.z;
#endif
    }
    barrier();
}

Point tile_point(int cell) {
    vec3 low = vec3(0);
#ifdef COMPENSATED
    low = vec3(low_x[cell], low_y[cell], low_z[cell]);
#endif
    return Point(vec3(tile_x[cell], tile_y[cell], tile_z[cell]), low);
}
#define NEIGHBOUR(dx, dy, dz) tile_point(cell + (dx) + tile_dims.x * (dy) + tile_dims.x * tile_dims.y * (dz))
#else
#define NEIGHBOUR(dx, dy, dz) point_of(index + dims.x * ((dy) + dims.y * (dz)) + (dx))
#endif

// Every neighbour is read, so that a fetch waits for no mask; what an absent one gives is dropped by
// selection, and a NaN in an inactive voxel stays there. `whole`: the particle has every neighbour of the
// groups that are compiled in.
vec3 implicit_force(const bool whole, int index, int cell, Point here, uint bits) {
    precise vec3 force = vec3(0);
    precise vec3 group;
#ifdef MATERIALS
    float compliance = compliances[index];
#define WITH_MATERIAL(dx, dy, dz)                                                                       \
    precise float stiffness =                                                                           \
        fast_series_stiffness(compliance, compliances[index + dims.x * ((dy) + dims.y * (dz)) + (dx)]); \
    pull.w *= stiffness;
#else
#define WITH_MATERIAL(dx, dy, dz)
#endif
#define ADD(bit, dx, dy, dz)                                                                          \
    {                                                                                                 \
        precise vec4 pull = unit_pull(between(here, NEIGHBOUR(dx, dy, dz)), REST_OF(bit, dx, dy, dz), \
                                      rest_length[(bit) / 2]);                                        \
        WITH_MATERIAL(dx, dy, dz)                                                                     \
        if (whole || (bits & (1u << (bit))) != 0u) group = with_pull(pull, group);                    \
    }
#ifdef FACES
    group = vec3(0);
    FACE_NEIGHBOURS(ADD)
    force = group * group_stiffness[0];
#endif
#ifdef EDGES
    group = vec3(0);
    EDGE_NEIGHBOURS(ADD)
    force += group * group_stiffness[1];
#endif
#ifdef CORNERS
    group = vec3(0);
    CORNER_NEIGHBOURS(ADD)
    force += group * group_stiffness[2];
#endif
    return force;
}

// Whether the particles of this subgroup's invocations have every neighbour of the groups that are compiled
// in.
bool all_whole(uint bits) {
#ifdef VOTE
    uint all_bits = 0u;
#ifdef FACES
    all_bits |= FACE_BITS;
#endif
#ifdef EDGES
    all_bits |= EDGE_BITS;
#endif
#ifdef CORNERS
    all_bits |= CORNER_BITS;
#endif
    return subgroupAll((bits & all_bits) == all_bits);
#else
    return false;
#endif
}

void main() {
#ifdef ORIGINS
    ivec3 origin = origins[gl_WorkGroupID.x + gl_NumWorkGroups.x * gl_WorkGroupID.y].xyz;
#else
    ivec3 origin = ivec3(gl_WorkGroupID * gl_WorkGroupSize);
#endif
    int cell = 0;
#ifdef TILE
    fill_tile(origin);
    cell = tile_cell(ivec3(gl_LocalInvocationID) + 1);
#endif
    ivec3 voxel = origin + ivec3(gl_LocalInvocationID);
    if (any(greaterThanEqual(voxel, dims))) return;
    int index = word_of(voxel);
    vec4 self = WORD(index);
    uint bits = floatBitsToUint(self.w);
    if (bits == 0u) return;
    vec3 before = before_of(index);
    vec3 low = vec3(0);
#ifdef COMPENSATED
    low = WORD_LOW(index).xyz;
#endif
    Point here = Point(self.xyz, low);
    vec3 force;
    if (all_whole(bits)) {
        force = implicit_force(true, index, cell, here, bits);
    } else {
        force = implicit_force(false, index, cell, here, bits);
    }
    integrate_and_store(index, here, bits, before, force);
}
