// Normals of a body's surface: the mean of the faces around a vertex, weighted by their area. One invocation
// per vertex.
layout(local_size_x = 64) in;

layout(std430, binding = 0) restrict readonly buffer Places { vec4 places[]; };
layout(std430, binding = 1) restrict readonly buffer Faces { uvec4 faces[]; };
// The tables of BodyMesh.
layout(std430, binding = 2) restrict readonly buffer FirstFace { uint first_face[]; };
layout(std430, binding = 3) restrict readonly buffer FaceOfVertex { uint face_of_vertex[]; };
layout(std430, binding = 4) restrict writeonly buffer Normals { vec4 normals[]; };

uniform int count;

void main() {
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        vec3 sum = vec3(0);
        for (uint k = first_face[n]; k < first_face[n + 1]; ++k) {
            uvec4 face = faces[face_of_vertex[k]];
            sum +=
                cross(places[face[2]].xyz - places[face[0]].xyz, places[face[3]].xyz - places[face[1]].xyz);
        }
        normals[n] = vec4(sum, 0);
    }
}
