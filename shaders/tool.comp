// What the tool does to the particles that it holds, before each step: one invocation a particle. Its force
// and the particle's own load are the load of the step. COMPENSATED as in motion.glsl; with TEXELS the state
// lies in textures, as in particle.glsl, and a word is a texel, x in its lower half and y in the upper.
#include "spring.h"
#include "uniforms.glsl"

layout(local_size_x = 64) in;

#ifdef TEXELS
layout(binding = 0) uniform sampler2D position;
layout(binding = 2) uniform sampler2D position_low;
layout(binding = 0, rgba32f) writeonly uniform image2D loads;
#define TEXEL(word) ivec2((word)&0xFFFFu, (word) >> 16)
#define WORD(word) texelFetch(position, TEXEL(word), 0)
#define WORD_LOW(word) texelFetch(position_low, TEXEL(word), 0)
#else
// As in compute.glsl.
layout(std430, binding = 0) restrict readonly buffer Words { Vec4 words[]; };
layout(std430, binding = 3) restrict readonly buffer WordsLow { Vec4 words_low[]; };
layout(std430, binding = 6) restrict writeonly buffer Loads { Real loads[]; };
#define WORD(word) words[word]
#define WORD_LOW(word) words_low[word]
#endif

// HeldWord of backends/layout/records/tool.h.
struct HeldWord {
    Vec3 anchor;
    uint word;
    Vec3 load;
};
layout(std430, binding = 11) restrict readonly buffer Held { HeldWord held[]; };
layout(std430, binding = 12) restrict writeonly buffer Forces { Vec4 forces[]; };

UNIFORMS(ToolUniforms, 19)
UNIFORM int count;
UNIFORM Real stiffness;
UNIFORM Vec3 moved;
END_UNIFORMS

void main() {
    // Strides, since the number of groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint word = held[n].word;
#ifdef COMPENSATED
        Vec3 low = WORD_LOW(word).xyz;
#else
        Vec3 low = Vec3(0);
#endif
        precise Vec3 force = hold_force(held[n].anchor, WORD(word).xyz, low, moved, stiffness);
        precise Vec3 load = held[n].load + force;
#ifdef TEXELS
        imageStore(loads, TEXEL(word), vec4(load, 0));
#else
        loads[3 * word] = load.x;
        loads[3 * word + 1] = load.y;
        loads[3 * word + 2] = load.z;
#endif
        forces[n] = Vec4(force, 0);
    }
}
