// Independent multiply-adds, 64 of them per round, in a fragment shader or, with COMPUTE, in a compute
// shader. The sums converge to 2.
#include "portable.h"
#include "uniforms.glsl"

UNIFORMS(ArithmeticUniforms, 19)
UNIFORM int rounds;
UNIFORM Real factor;
END_UNIFORMS

Vec4 sums(uvec2 place) {
    Vec4 a = Vec4(place.xyxy);
    Vec4 b = a + 1;
    for (int n = 0; n < rounds; ++n) {
        for (int m = 0; m < 8; ++m) {
            a = a * factor + 1;
            b = b * factor + 1;
        }
    }
    return a + b;
}

#ifdef COMPUTE
layout(local_size_x = 16, local_size_y = 16) in;
#ifdef STORAGE_BUFFERS
layout(std430, binding = 0) restrict writeonly buffer Next { Vec4 next[]; };
void main() {
    next[gl_GlobalInvocationID.x + gl_NumWorkGroups.x * gl_WorkGroupSize.x * gl_GlobalInvocationID.y] =
        sums(gl_GlobalInvocationID.xy);
}
#else
layout(binding = 0, rgba32f) uniform writeonly image2D next;
void main() { imageStore(next, ivec2(gl_GlobalInvocationID.xy), sums(gl_GlobalInvocationID.xy)); }
#endif
#else
layout(location = 0) out vec4 next;
void main() { next = sums(uvec2(gl_FragCoord.xy)); }
#endif
