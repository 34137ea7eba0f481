// Measures rest lengths in place: one invocation a number.
#include "measured.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 0) restrict buffer Lengths { float lengths[]; };

// Number n is at n * stride + offset.
uniform int count;
uniform int stride;
uniform int offset;

void main() {
    // Strides, since the number of groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint at = n * uint(stride) + uint(offset);
        lengths[at] = measured_or_zero(lengths[at]);
    }
}
