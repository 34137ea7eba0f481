// Updates particles whose springs changed. Invocations stride over the particles. They write a particle's
// bits and, with LISTS, its list; with PER_SPRING also the constants of each spring, and with
// OFF_LATTICE_REST the rest vectors of springs that are not of the lattice.
layout(local_size_x = 64) in;

layout(binding = 0, rgba32f) uniform image2D position;
#ifdef LISTS
layout(binding = 1, r32ui) writeonly uniform uimage2DArray neighbour;
#endif
#ifdef PER_SPRING
layout(binding = 2, rg32f) writeonly uniform image2DArray spring;
#endif
#ifdef OFF_LATTICE_REST
layout(binding = 3, rgba32f) writeonly uniform image2DArray off_lattice_rest;
#endif

// A particle's texel (x in the lower half, y in the upper half), its bits, and where its list begins and ends
// in the buffers below.
layout(std430, binding = 0) readonly buffer Particles { uvec4 particles[]; };
layout(std430, binding = 1) readonly buffer Neighbours { uint neighbours[]; };
layout(std430, binding = 2) readonly buffer Springs { vec2 springs[]; };
layout(std430, binding = 3) readonly buffer OffLatticeRests { vec4 off_lattice_rests[]; };

uniform int particle_count;

void main() {
    // Invocations stride, since the number of work groups has a limit.
    for (uint n = gl_GlobalInvocationID.x; n < uint(particle_count);
         n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uvec4 particle = particles[n];
        ivec2 texel = ivec2(particle.x & 0xFFFFu, particle.x >> 16);
        vec3 here = imageLoad(position, texel).xyz;
        imageStore(position, texel, vec4(here, uintBitsToFloat(particle.y)));
#ifdef LISTS
        for (uint k = particle.z; k < particle.w; ++k) {
            ivec3 slot = ivec3(texel, k - particle.z);
            imageStore(neighbour, slot, uvec4(neighbours[k], 0, 0, 0));
#ifdef PER_SPRING
            imageStore(spring, slot, vec4(springs[k], 0, 0));
#endif
#ifdef OFF_LATTICE_REST
            imageStore(off_lattice_rest, slot, off_lattice_rests[k]);
#endif
        }
#endif
    }
}
