// New lists of some particles: one invocation a slot of a row. SECONDARY and OFF_LATTICE_REST as in
// gl_compute_explicit.comp; with SQUARED, rest lengths are squares and have to be measured.
#include "measured.glsl"

layout(local_size_x = 64) in;

// What the particles' lists become, one row after the other.
layout(std430, binding = 0) restrict readonly buffer Particles { uint edited[]; };
layout(std430, binding = 1) restrict readonly buffer NewNeighbours { uint new_neighbours[]; };
layout(std430, binding = 2) restrict readonly buffer NewConstants { vec2 new_constants[]; };
layout(std430, binding = 3) restrict readonly buffer NewOffLatticeRests { vec4 new_off_lattice_rests[]; };
layout(std430, binding = 8) restrict writeonly buffer Neighbours { uint neighbours[]; };
layout(std430, binding = 9) restrict writeonly buffer Constants { vec2 constants[]; };
layout(std430, binding = 10) restrict writeonly buffer OffLatticeRests { vec4 off_lattice_rests[]; };

uniform int count;
uniform int list_slots;  // of a row
uniform int slot_stride;

void main() {
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint at = edited[n / uint(list_slots)] + n % uint(list_slots) * uint(slot_stride);
        neighbours[at] = new_neighbours[n];
#ifdef SECONDARY
        vec2 spring = new_constants[n];
#ifdef SQUARED
        spring.y = measured_or_zero(spring.y);
#endif
        constants[at] = spring;
#endif
#ifdef OFF_LATTICE_REST
        off_lattice_rests[at] = new_off_lattice_rests[n];
#endif
    }
}
