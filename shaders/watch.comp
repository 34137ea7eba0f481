// One invocation a texel: whether its particle is where a run may take it. BY_INCREMENTS as in particle.glsl.
#include "neighbours.h"

layout(local_size_x = 64) in;

layout(binding = 0) uniform sampler2D position;
// With BY_INCREMENTS the increment, else the position before.
layout(binding = 1) uniform sampler2D other;

// The first look that failed.
layout(std430, binding = 0) buffer Found { uint found; };

uniform int look;
uniform float inverse_largest;  // 1 / the largest increment

const uint infinite = 0x7F800000u;  // bits of infinity, and the exponent of whatever is not finite

void main() {
    ivec2 size = textureSize(position, 0);
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (texel.x >= size.x) return;
    vec4 here = texelFetch(position, texel, 0);
    if ((floatBitsToUint(here.w) & ACTIVE_BIT) == 0u) return;
    precise vec3 increment = texelFetch(other, texel, 0).xyz;
#ifndef BY_INCREMENTS
    increment = here.xyz - increment;
#endif
    precise vec3 share = increment * inverse_largest;
    // As integers, since a compiler may take it that there is no NaN: floats of one sign are in the order of
    // their bits, and NaN comes last.
    bool fast = floatBitsToUint(dot(share, share)) > floatBitsToUint(1.0);
    bool finite = all(lessThan(floatBitsToUint(here.xyz) & infinite, uvec3(infinite)));
    if ((fast || !finite) && uint(look) < found) atomicMin(found, uint(look));
}
