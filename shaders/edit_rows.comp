// Writes new lists of some particles. Invocations stride over the slots of all these lists. SECONDARY says
// that there is a list of springs' constants, and OFF_LATTICE_REST that the new lists have rest offsets. With
// SQUARED, new rest lengths come as squares (measured.glsl).
#ifdef ADDRESSED
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif
#include "measured.glsl"
#include "uniforms.glsl"
#define LIST_ACCESS writeonly
#include "lists.glsl"

#ifdef VULKAN
layout(constant_id = 12) const bool SECONDARY = false;
layout(constant_id = 13) const bool OFF_LATTICE_REST = false;
layout(constant_id = 14) const bool SQUARED = false;
#endif

layout(local_size_x = 64) in;

// The edited particles. Their new lists lie one after the other, with list_slots elements per particle.
layout(std430, binding = 0) restrict readonly buffer Particles { uint edited[]; };
layout(std430, binding = 1) restrict readonly buffer NewNeighbours { uint new_neighbours[]; };
layout(std430, binding = 2) restrict readonly buffer NewConstants { Vec2 new_constants[]; };
layout(std430, binding = 3) restrict readonly buffer NewOffLatticeRests { Vec4 new_off_lattice_rests[]; };

UNIFORMS(EditUniforms, 19)
UNIFORM int count;
UNIFORM int list_slots;  // slots per particle
UNIFORM int slot_stride;
END_UNIFORMS

void main() {
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        Place at = PLACE(int(edited[n / uint(list_slots)]), int(n % uint(list_slots)));
        LISTED(neighbours, at) = new_neighbours[n];
        if (SECONDARY) {
            Vec2 spring = new_constants[n];
            if (SQUARED) spring.y = measured_or_zero(spring.y);
            LISTED(constants, at) = spring;
        }
        if (OFF_LATTICE_REST) LISTED(off_lattice_rests, at) = new_off_lattice_rests[n];
    }
}
