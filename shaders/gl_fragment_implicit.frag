// One fragment a voxel of the grid that lies flat, slice by slice; a neighbour's texel follows from the
// particle's own. FACES, EDGES and CORNERS are defined where the scene has springs of that group.
#include "particle.glsl"

uniform float rest_length[26];  // by mask bit
uniform float group_stiffness[3];

uniform int slice_width;
uniform int slice_height;
uniform int last_column;  // x of the first texel of the last slice in a row of slices

void main() {
    Particle particle = own_particle();
    ivec2 texel = particle.texel;
    uint bits = bits_of(particle);
    // From a voxel to the one below and above it. Those of the first and the last slice lead nowhere, and
    // no bit says to follow them.
    ivec2 below = texel.x >= slice_width ? ivec2(-slice_width, 0) : ivec2(last_column, -slice_height);
    ivec2 above = texel.x < last_column ? ivec2(slice_width, 0) : ivec2(-last_column, slice_height);
#ifdef MATERIALS
    float compliance = texelFetch(material, texel, 0).x;
#define STIFFNESS(group, there) \
    (group_stiffness[group] * series_stiffness(compliance, texelFetch(material, there, 0).x))
#else
#define STIFFNESS(group, there) group_stiffness[group]
#endif

#define ADD(bit, dx, dy, dz, group)                                                         \
    if ((bits & (1u << bit)) != 0u) {                                                       \
        ivec2 there = texel + ivec2(dx, dy) + (dz < 0 ? below : dz > 0 ? above : ivec2(0)); \
        force += pull(particle, there, rest_of(ivec3(dx, dy, dz), bit), rest_length[bit],   \
                      STIFFNESS(group, there));                                             \
    }
#define ADD_FACE(bit, dx, dy, dz) ADD(bit, dx, dy, dz, 0)
#define ADD_EDGE(bit, dx, dy, dz) ADD(bit, dx, dy, dz, 1)
#define ADD_CORNER(bit, dx, dy, dz) ADD(bit, dx, dy, dz, 2)

    precise vec3 force = vec3(0);
#ifdef FACES
    FACE_NEIGHBOURS(ADD_FACE)
#endif
#ifdef EDGES
    EDGE_NEIGHBOURS(ADD_EDGE)
#endif
#ifdef CORNERS
    CORNER_NEIGHBOURS(ADD_CORNER)
#endif
    advance(particle, force);
}
