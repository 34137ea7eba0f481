// Reads and writes memory, to measure its bandwidth. An invocation reads one word of 16 bytes, or two if
// READS is 2. With WRITES it also writes a word; with IN_PLACE that word replaces the second one.
#include "uniforms.glsl"

#ifdef VULKAN
layout(constant_id = 3) const int READS = 2;
layout(constant_id = 4) const bool WRITES = false;
layout(constant_id = 5) const bool IN_PLACE = false;
#endif
layout(local_size_x = 256) in;
layout(std430, binding = 0) restrict readonly buffer First { vec4 first[]; };
layout(std430, binding = 1) restrict buffer Second { vec4 second[]; };
layout(std430, binding = 2) restrict writeonly buffer Written { vec4 written[]; };
UNIFORMS(CopyUniforms, 19)
UNIFORM float impossible;  // a sum that never occurs, which the compiler cannot know
END_UNIFORMS

void main() {
    uint n = gl_GlobalInvocationID.x;
    vec4 word = first[n];
    if (READS == 2) word -= second[n];
    if (IN_PLACE) {
        second[n] = word;
    } else if (WRITES || word.x + word.y + word.z + word.w == impossible) {
        written[WRITES ? n : 0] = word;
    }
}
