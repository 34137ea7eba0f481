// Normals of a body's surface: for each vertex the sum of the normals of the faces around it, weighted by
// area. Invocations stride over the vertices. Further passes (`smoothing`) add up the normals of these faces'
// vertices instead, which smooths the steps between slices of voxels. The normals are not normalised.
layout(local_size_x = 64) in;

// Positions of vertices or, in a smoothing pass, their normals.
layout(std430, binding = 0) restrict readonly buffer Places { vec4 places[]; };
layout(std430, binding = 1) restrict readonly buffer Faces { uvec4 faces[]; };
// The faces around each vertex: vertex n has face_of_vertex[first_face[n]] up to the one before
// face_of_vertex[first_face[n + 1]].
layout(std430, binding = 2) restrict readonly buffer FirstFace { uint first_face[]; };
layout(std430, binding = 3) restrict readonly buffer FaceOfVertex { uint face_of_vertex[]; };
layout(std430, binding = 4) restrict writeonly buffer Normals { vec4 normals[]; };

uniform int count;
uniform int smoothing;  // 1 in a smoothing pass
uniform float unit;     // one over the size of the body

void main() {
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        vec3 sum = vec3(0);
        for (uint k = first_face[n]; k < first_face[n + 1]; ++k) {
            uvec4 face = faces[face_of_vertex[k]];
            vec3 a = places[face[0]].xyz, b = places[face[1]].xyz;
            vec3 c = places[face[2]].xyz, d = places[face[3]].xyz;
            sum += smoothing == 0 ? cross(unit * (c - a), unit * (d - b)) : a + b + c + d;
        }
        normals[n] = vec4(sum, 0);
    }
}
