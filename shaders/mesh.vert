// A body's surface as a camera sees it, from buffers that compute shaders have filled (mesh_vertices.comp).
layout(std430, binding = 0) restrict readonly buffer Places { vec4 places[]; };
layout(std430, binding = 1) restrict readonly buffer Normals { vec4 normals[]; };

uniform vec4 to_eye[3];   // rows of a matrix to camera space: x to the right, y up, z towards the viewer
uniform vec4 to_clip[4];  // rows of a matrix to clip space

// Maps a vertex's value to the range of colours, 0 to 1: the value times colour_scale.x plus colour_scale.y.
uniform vec3 colour_scale;

out vec3 surface_normal;
out float surface_value;

void main() {
    vec4 place = vec4(places[gl_VertexID].xyz, 1);
    vec3 normal = normals[gl_VertexID].xyz;
    surface_normal = vec3(dot(to_eye[0].xyz, normal), dot(to_eye[1].xyz, normal), dot(to_eye[2].xyz, normal));
    surface_value = places[gl_VertexID].w * colour_scale.x + colour_scale.y;
    gl_Position =
        vec4(dot(to_clip[0], place), dot(to_clip[1], place), dot(to_clip[2], place), dot(to_clip[3], place));
}
