// Replaces squares of rest lengths by the lengths (measured.glsl). Invocations stride over the lengths.
#include "measured.glsl"
#include "uniforms.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 0) restrict buffer Lengths { Real lengths[]; };

// Length n is lengths[n * stride + offset].
UNIFORMS(MeasureUniforms, 19)
UNIFORM int count;
UNIFORM int stride;
UNIFORM int offset;
END_UNIFORMS

void main() {
    // Invocations stride, since the number of work groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint at = n * uint(stride) + uint(offset);
        lengths[at] = measured_or_zero(lengths[at]);
    }
}
