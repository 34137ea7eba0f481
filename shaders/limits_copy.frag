// Two texels read, one written: the memory traffic of a step.
layout(binding = 0) uniform sampler2D position;
layout(binding = 1) uniform sampler2D previous_position;
layout(location = 0) out vec4 next;
void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    next = texelFetch(position, texel, 0) - texelFetch(previous_position, texel, 0);
}
