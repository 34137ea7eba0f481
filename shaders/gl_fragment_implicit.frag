// One fragment per voxel of the grid, which lies flat, slice by slice. A neighbour's texel follows from the
// particle's texel. FACES, EDGES and CORNERS say which groups of springs are compiled in (terms.glsl).
#include "particle.glsl"

uniform float rest_length[13];  // index: mask bit / 2
uniform float group_stiffness[3];

uniform int slice_width;
uniform int slice_height;
uniform int last_column;  // x of the first texel of the last slice in a row of slices

void main() {
    Particle particle = own_particle();
    ivec2 texel = particle.texel;
    uint bits = bits_of(particle);
    // Offsets in texels to the voxels at z - 1 and z + 1. In the first and the last slice one of them is
    // invalid, and no mask bit uses it.
    ivec2 below = texel.x >= slice_width ? ivec2(-slice_width, 0) : ivec2(last_column, -slice_height);
    ivec2 above = texel.x < last_column ? ivec2(slice_width, 0) : ivec2(-last_column, slice_height);
    float compliance = MATERIALS ? texelFetch(material, texel, 0).x : 0.0;
#define WITH_MATERIAL                                                                                  \
    if (MATERIALS) {                                                                                   \
        precise float stiffness = fast_series_stiffness(compliance, texelFetch(material, there, 0).x); \
        pull.w *= stiffness;                                                                           \
    }

#define ADD(bit, dx, dy, dz)                                                                            \
    if ((bits & (1u << bit)) != 0u) {                                                                   \
        ivec2 there = texel + ivec2(dx, dy) + (dz < 0 ? below : dz > 0 ? above : ivec2(0));             \
        precise vec4 pull = pull_of(particle, there, REST_OF(bit, dx, dy, dz), rest_length[(bit) / 2]); \
        WITH_MATERIAL                                                                                   \
        group = with_pull(pull, group);                                                                 \
    }

    precise vec3 force = vec3(0);
    precise vec3 group;
    if (FACES) {
        group = vec3(0);
        FACE_NEIGHBOURS(ADD)
        force = group * group_stiffness[0];
    }
    if (EDGES) {
        group = vec3(0);
        EDGE_NEIGHBOURS(ADD)
        force += group * group_stiffness[1];
    }
    if (CORNERS) {
        group = vec3(0);
        CORNER_NEIGHBOURS(ADD)
        force += group * group_stiffness[2];
    }
    integrate_and_store(particle, force);
}
