// One or two words read and, with WRITES, one written: where IN_PLACE is defined over the second.
layout(local_size_x = 256) in;
layout(std430, binding = 0) restrict readonly buffer First { vec4 first[]; };
layout(std430, binding = 1) restrict buffer Second { vec4 second[]; };
layout(std430, binding = 2) restrict writeonly buffer Written { vec4 written[]; };
uniform float impossible;  // a sum that there is not, which the compiler cannot know

void main() {
    uint n = gl_GlobalInvocationID.x;
    vec4 word = first[n];
#if READS == 2
    word -= second[n];
#endif
#if defined(IN_PLACE)
    second[n] = word;
#elif defined(WRITES)
    written[n] = word;
#else
    if (word.x + word.y + word.z + word.w == impossible) written[0] = word;
#endif
}
