// Reads one or two texels and, with WRITES, writes one, to measure the memory's bandwidth.
layout(binding = 0) uniform sampler2D first;
layout(binding = 1) uniform sampler2D second;
uniform float impossible;  // a sum that never occurs, which the compiler cannot know
layout(location = 0) out vec4 written;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 word = texelFetch(first, texel, 0);
#if READS == 2
    word -= texelFetch(second, texel, 0);
#endif
#ifndef WRITES
    if (word.x + word.y + word.z + word.w != impossible) discard;
#endif
    written = word;
}
