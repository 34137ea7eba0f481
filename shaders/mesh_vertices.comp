// Computes where the vertices of a body's surface are. Invocations stride over the vertices. Each vertex
// moves by the mean displacement of up to eight particles.
layout(local_size_x = 64) in;

// A vertex (BodyMesh::Vertex): its place at rest, and the `count` particles that it follows.
struct Vertex {
    float rest[3];
    uint count;
    uint follows[8];
};
layout(std430, binding = 0) restrict readonly buffer Vertices { Vertex vertices[]; };
layout(std430, binding = 1) restrict readonly buffer Displacements { vec4 displacements[]; };
// The values to show, one per element of `displacements`. Not used if the length of the displacement is
// shown.
layout(std430, binding = 2) restrict readonly buffer Values { float values[]; };
// The place of a vertex in xyz, and its value in w.
layout(std430, binding = 3) restrict writeonly buffer Places { vec4 places[]; };

uniform int count;
uniform int by_values;

void main() {
    for (uint n = gl_GlobalInvocationID.x; n < uint(count); n += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        Vertex vertex = vertices[n];
        vec3 moved = vec3(0);
        float value = 0;
        for (uint k = 0; k < vertex.count; ++k) {
            vec3 displacement = displacements[vertex.follows[k]].xyz;
            moved += displacement;
            value += by_values != 0 ? values[vertex.follows[k]] : length(displacement);
        }
        moved /= float(vertex.count);
        places[n] =
            vec4(vec3(vertex.rest[0], vertex.rest[1], vertex.rest[2]) + moved, value / float(vertex.count));
    }
}
