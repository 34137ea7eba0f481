// Independent multiply-adds, 64 of them a round: in a fragment shader or, with COMPUTE, in a compute shader.
// The sums converge to 2.
uniform int rounds;
uniform float factor;

vec4 sums(uvec2 place) {
    vec4 a = vec4(place.xyxy);
    vec4 b = a + 1;
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
layout(binding = 0, rgba32f) uniform writeonly image2D next;
void main() { imageStore(next, ivec2(gl_GlobalInvocationID.xy), sums(gl_GlobalInvocationID.xy)); }
#else
layout(location = 0) out vec4 next;
void main() { next = sums(uvec2(gl_FragCoord.xy)); }
#endif
