// A body's surface, already in the coordinates of the camera: x to the right, y up, z towards the viewer, all
// from -1 to 1.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in float value;

uniform vec3 scale;   // to clip space, which needs the picture's proportions
uniform vec3 offset;  // in clip space

out vec3 surface_normal;
out float surface_value;

void main() {
    surface_normal = normal;
    surface_value = value;
    gl_Position = vec4(scale * position + offset, 1);
}
