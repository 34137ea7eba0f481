// Applies the tool to the particles that it holds, before each step: a particle's load for the step is the
// particle's own load plus the tool's force.
#include "some_words.glsl"
#include "spring.h"
#include "uniforms.glsl"

layout(local_size_x = 64) in;

#ifdef TEXELS
layout(binding = 0, rgba32f) writeonly uniform image2D loads;
#else
layout(std430, binding = 6) restrict writeonly buffer Loads { Real loads[]; };
#endif

// A held particle (backends/layout/records/tool.h): where it was when the tool took hold, and its own load.
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
    // Invocations stride, since the number of work groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint word = held[n].word;
        precise Vec3 force = hold_force(held[n].anchor, WORD(word).xyz, LOW(word), moved, stiffness);
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
