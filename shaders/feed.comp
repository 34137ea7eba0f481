// Writes the displacements of some particles for a picture. Invocations stride over the particles.
#include "some_words.glsl"
#include "uniforms.glsl"

layout(local_size_x = 64) in;

// A particle (backends/layout/records/feed.h). `rest` is its rest position, or 0 if words have displacements;
// `word` is the index of its word.
struct FedWord {
    Vec3 rest;
    uint word;
};
layout(std430, binding = 11) restrict readonly buffer Fed { FedWord fed[]; };
layout(std430, binding = 12) restrict writeonly buffer Displacements { vec4 displacements[]; };

UNIFORMS(FeedUniforms, 20)
UNIFORM int count;
END_UNIFORMS

void main() {
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint word = fed[n].word;
        displacements[n] = vec4((WORD(word).xyz - fed[n].rest) + LOW(word), 0);
    }
}
