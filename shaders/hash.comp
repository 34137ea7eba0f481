// Adds the hash of an array's words, or of a texture's components, to `sums`. Invocations stride over the
// words or components.
#include "state_hash.h"
#include "uniforms.glsl"

layout(local_size_x = 64) in;

#ifdef STORAGE_BUFFERS
layout(std430, binding = 0) restrict readonly buffer Words { uint words[]; };
#else
layout(binding = 0) uniform sampler2D texels;
#endif
layout(std430, binding = 1) restrict buffer Sums { uint sums[STATE_HASH_SUMS]; };

UNIFORMS(HashUniforms, 19)
UNIFORM int array_number;
UNIFORM int count;  // words of 32 bits
END_UNIFORMS

uint word_at(uint n) {
#ifdef STORAGE_BUFFERS
    return words[n];
#else
    int texel = int(n / 4u), width = textureSize(texels, 0).x;
    return floatBitsToUint(texelFetch(texels, ivec2(texel % width, texel / width), 0)[n % 4u]);
#endif
}

void main() {
    uint own[STATE_HASH_SUMS];
    for (uint sum = 0u; sum < uint(STATE_HASH_SUMS); ++sum) own[sum] = 0u;
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint word = word_at(n);
        for (uint sum = 0u; sum < uint(STATE_HASH_SUMS); ++sum)
            own[sum] += hashed_word(word, n, uint(array_number), sum);
    }
    for (uint sum = 0u; sum < uint(STATE_HASH_SUMS); ++sum) atomicAdd(sums[sum], own[sum]);
}
