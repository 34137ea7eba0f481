// One invocation per voxel: its neighbours are at fixed offsets in the grid, and its mask says which of them
// exist. FACES, EDGES and CORNERS say which groups of springs are compiled in (terms.glsl). ORIGINS says that
// only the work groups with an active voxel are dispatched. VOTE says that a subgroup runs code without masks
// if all its particles have every neighbour of these groups. TILE is defined if neighbours come from shared
// memory. SUBGROUPS is defined if votes are compiled in.
//
// Guard words lie before the first voxel and after the last one: the neighbours of any voxel, inside the
// lattice or not, are words that may be read.
#ifdef SUBGROUPS
#extension GL_KHR_shader_subgroup_vote : require
#endif
#include "compute.glsl"

#ifdef VULKAN
layout(local_size_x_id = 0, local_size_y_id = 1, local_size_z_id = 2) in;
layout(constant_id = 12) const bool ORIGINS = false;
layout(constant_id = 13) const bool VOTE = false;
layout(constant_id = 14) const int DIMS_X = 0;
layout(constant_id = 15) const int DIMS_Y = 0;
layout(constant_id = 16) const int DIMS_Z = 0;
layout(constant_id = 17) const int FIRST_WORD = 0;
#else
layout(local_size_x = BLOCK_X, local_size_y = BLOCK_Y, local_size_z = BLOCK_Z) in;
#endif

layout(std430, binding = 8) restrict readonly buffer Compliances { Real compliances[]; };
// The voxel at which each work group begins.
layout(std430, binding = 9) restrict readonly buffer Origins { ivec4 origins[]; };

UNIFORMS(ImplicitUniforms, 19)
UNIFORM ivec3 grid_dims;
UNIFORM int grid_first_word;
// Rest lengths by mask bit / 2: opposite directions share one.
UNIFORM Real rest_length[13];
UNIFORM Real group_stiffness[3];
END_UNIFORMS

// If DIMS_X is not 0, the extents are constants, and the compiler knows the offset of each neighbour.
#define dims (DIMS_X > 0 ? ivec3(DIMS_X, DIMS_Y, DIMS_Z) : grid_dims)
#define first_word (DIMS_X > 0 ? FIRST_WORD : grid_first_word)

int word_of(ivec3 voxel) { return first_word + voxel.x + dims.x * (voxel.y + dims.y * voxel.z); }

#ifdef TILE
// The group's voxels and a frame of one voxel around them. Each axis is a separate array, so that
// neighbouring invocations read neighbouring banks.
const ivec3 tile_dims = ivec3(BLOCK_X, BLOCK_Y, BLOCK_Z) + 2;
const int tile_cells = tile_dims.x * tile_dims.y * tile_dims.z;
shared Real tile_x[tile_cells], tile_y[tile_cells], tile_z[tile_cells];
#ifdef COMPENSATED
shared Real low_x[tile_cells], low_y[tile_cells], low_z[tile_cells];
#endif

int tile_cell(ivec3 at) { return at.x + tile_dims.x * (at.y + tile_dims.y * at.z); }

// Cells more than one voxel beyond the far faces of the lattice stay unset: they belong to no spring.
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
    Vec3 low = Vec3(0);
#ifdef COMPENSATED
    low = Vec3(low_x[cell], low_y[cell], low_z[cell]);
#endif
    return Point(Vec3(tile_x[cell], tile_y[cell], tile_z[cell]), low);
}
#define NEIGHBOUR(dx, dy, dz) tile_point(cell + (dx) + tile_dims.x * (dy) + tile_dims.x * tile_dims.y * (dz))
#else
#define NEIGHBOUR(dx, dy, dz) point_of(index + dims.x * ((dy) + dims.y * (dz)) + (dx))
#endif

// Sum of the particle's spring forces. Every neighbour is read, present or not, so that no fetch waits for
// the mask. A selection then drops the force of an absent neighbour, so that a NaN in an inactive voxel does
// not spread. `whole`: the particle has every neighbour of the groups that are compiled in.
Vec3 implicit_force(const bool whole, int index, int cell, Point here, uint bits) {
    precise Vec3 force = Vec3(0);
    precise Vec3 group;
    Real compliance = MATERIALS ? compliances[index] : 0;
#define WITH_MATERIAL(dx, dy, dz)                                                                           \
    if (MATERIALS) {                                                                                        \
        precise Real stiffness =                                                                            \
            fast_series_stiffness(compliance, compliances[index + dims.x * ((dy) + dims.y * (dz)) + (dx)]); \
        pull.w *= stiffness;                                                                                \
    }
#define ADD(bit, dx, dy, dz)                                                                          \
    {                                                                                                 \
        precise Vec4 pull = unit_pull(between(here, NEIGHBOUR(dx, dy, dz)), REST_OF(bit, dx, dy, dz), \
                                      rest_length[(bit) / 2]);                                        \
        WITH_MATERIAL(dx, dy, dz)                                                                     \
        if (whole || (bits & (1u << (bit))) != 0u) group = with_pull(pull, group);                    \
    }
    if (FACES) {
        group = Vec3(0);
        FACE_NEIGHBOURS(ADD)
        force = group * group_stiffness[0];
    }
    if (EDGES) {
        group = Vec3(0);
        EDGE_NEIGHBOURS(ADD)
        force += group * group_stiffness[1];
    }
    if (CORNERS) {
        group = Vec3(0);
        CORNER_NEIGHBOURS(ADD)
        force += group * group_stiffness[2];
    }
    return force;
}

// Whether the particles of all invocations of this subgroup have every neighbour of the groups that are
// compiled in. Without VOTE the result is false.
bool all_whole(uint bits) {
#ifdef SUBGROUPS
    uint all_bits = (FACES ? FACE_BITS : 0u) | (EDGES ? EDGE_BITS : 0u) | (CORNERS ? CORNER_BITS : 0u);
    if (VOTE) return subgroupAll((bits & all_bits) == all_bits);
#endif
    return false;
}

void main() {
    ivec3 origin = ORIGINS ? origins[gl_WorkGroupID.x + gl_NumWorkGroups.x * gl_WorkGroupID.y].xyz
                           : ivec3(gl_WorkGroupID * gl_WorkGroupSize);
    int cell = 0;
#ifdef TILE
    fill_tile(origin);
    cell = tile_cell(ivec3(gl_LocalInvocationID) + 1);
#endif
    ivec3 voxel = origin + ivec3(gl_LocalInvocationID);
    if (any(greaterThanEqual(voxel, dims))) return;
    int index = word_of(voxel);
    Vec4 self = WORD(index);
    uint bits = BITS_OF(self.w);
    if (bits == 0u) return;
    Vec3 before = before_of(index);
    Vec3 low = Vec3(0);
#ifdef COMPENSATED
    low = WORD_LOW(index).xyz;
#endif
    Point here = Point(self.xyz, low);
    Vec3 force;
    if (all_whole(bits)) {
        force = implicit_force(true, index, cell, here, bits);
    } else {
        force = implicit_force(false, index, cell, here, bits);
    }
    integrate_and_store(index, here, bits, before, force);
}
