// One invocation a particle: its new bits.
layout(local_size_x = 64) in;

// Words as numbers, of which the fourth of each is its particle's bits.
layout(std430, binding = 0) restrict buffer Words { uint words[]; };
// A word and its bits.
layout(std430, binding = 1) restrict readonly buffer Edited { uvec2 edited[]; };

uniform int count;

void main() {
    // Strides, since the number of groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x)
        words[4u * edited[n].x + 3u] = edited[n].y;
}
