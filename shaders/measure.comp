// Rest lengths from their squares, as inverse_root() measures lengths: one invocation a number.
#include "inverse_root.h"

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
        // inverse_root() is for normal numbers, and 0 is no spring.
        lengths[at] = lengths[at] >= 1.17549435e-38 ? measured_length(lengths[at]) : 0.0;
    }
}
