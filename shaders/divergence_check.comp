// Checks that every particle's position is finite, and that its increment is within the limit
// (inverse_largest). There is one invocation per texel or, with STORAGE_BUFFERS, invocations stride over the
// words of compute.glsl. BY_INCREMENTS says that the state has increments.
#include "neighbours.h"
#include "portable.h"
#include "uniforms.glsl"
#include "words.glsl"

layout(local_size_x = 64) in;

// The increments if BY_INCREMENTS, otherwise the positions of the previous step. The texture `other` has
// either.
#ifdef STORAGE_BUFFERS
layout(std430, binding = 0) restrict readonly buffer Words { Vec4 words[]; };
#ifdef BY_INCREMENTS
layout(std430, binding = 2) restrict readonly buffer Increments { Real increments[]; };
#else
layout(std430, binding = 1) restrict readonly buffer Other { Vec4 other[]; };
#endif
#else
layout(binding = 0) uniform sampler2D position;
layout(binding = 1) uniform sampler2D other;
#endif

// The number of the first check that failed and, in Vulkan, the number of the next check: a check that is
// recorded once and replayed does not know its number (next_check.comp).
layout(std430, binding = 3) buffer Found {
    uint found;
#ifdef VULKAN
    uint next_check;
#endif
};

UNIFORMS(CheckUniforms, 19)
#ifndef VULKAN
UNIFORM int check_number;
#endif
UNIFORM Real inverse_largest;  // 1 / the largest increment
END_UNIFORMS
#ifdef VULKAN
#define check_number int(next_check)
#endif

const uint infinite = 0x7F800000u;  // the exponent bits of infinity and NaN

void check(Vec4 here, Vec3 before_or_increment) {
    if ((BITS_OF(here.w) & ACTIVE_BIT) == 0u) return;
    precise Vec3 increment = before_or_increment;
#ifndef BY_INCREMENTS
    increment = here.xyz - increment;
#endif
    // The check is in float32 even for a float64 state, so a position beyond the range of float32 counts as
    // not finite.
    precise vec3 share = vec3(increment * inverse_largest);
    // Floats are compared by their bits, since a compiler may assume that there is no NaN. As integers, the
    // bits of positive floats have the floats' order, and those of NaN are the largest.
    bool fast = floatBitsToUint(dot(share, share)) > floatBitsToUint(1.0);
    bool finite = all(lessThan(floatBitsToUint(vec3(here.xyz)) & infinite, uvec3(infinite)));
    if ((fast || !finite) && uint(check_number) < found) atomicMin(found, uint(check_number));
}

void main() {
#ifdef STORAGE_BUFFERS
    int count = words.length();
    for (int n = int(gl_GlobalInvocationID.x); n < count; n += int(gl_NumWorkGroups.x * gl_WorkGroupSize.x)) {
#ifdef BY_INCREMENTS
        int pitch = increments.length() / 3;
        check(words[n], Vec3(increments[n], increments[n + pitch], increments[n + 2 * pitch]));
#else
        check(words[n], other[n].xyz);
#endif
    }
#else
    ivec2 size = textureSize(position, 0);
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (texel.x >= size.x) return;
    check(texelFetch(position, texel, 0), texelFetch(other, texel, 0).xyz);
#endif
}
