// Does next to nothing, which shows what a dispatch and its barrier cost by themselves.
layout(local_size_x = 32) in;
layout(std430, binding = 0) restrict writeonly buffer Next { vec4 next[]; };
void main() { next[gl_GlobalInvocationID.x] = vec4(1); }
