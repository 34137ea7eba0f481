// Two words read, one written: the memory traffic of a step.
layout(local_size_x = 256) in;
layout(std430, binding = 0) restrict readonly buffer Position { vec4 position[]; };
layout(std430, binding = 1) restrict readonly buffer Previous { vec4 previous_position[]; };
layout(std430, binding = 2) restrict writeonly buffer Next { vec4 next[]; };
void main() {
    uint n = gl_GlobalInvocationID.x;
    next[n] = position[n] - previous_position[n];
}
