// Writes new bits of particles. Invocations stride over the particles.
#include "uniforms.glsl"

layout(local_size_x = 64) in;

// A word has four numbers of 32 bits, or eight in float64. The particle's bits are the fourth number, or the
// seventh in float64.
#ifdef VOXSPRING_FLOAT64
const uint word_numbers = 8u, place_of_bits = 6u;
#else
const uint word_numbers = 4u, place_of_bits = 3u;
#endif
layout(std430, binding = 0) restrict buffer Words { uint words[]; };
// x: index of a particle's word; y: the particle's new bits.
layout(std430, binding = 1) restrict readonly buffer Edited { uvec2 edited[]; };

UNIFORMS(EditUniforms, 19)
UNIFORM int count;
END_UNIFORMS

void main() {
    // Invocations stride, since the number of work groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x)
        words[word_numbers * edited[n].x + place_of_bits] = edited[n].y;
}
