// One triangle that covers the viewport. Its corners follow from the numbers of the vertices.
void main() { gl_Position = vec4(4 * (gl_VertexID & 1) - 1, 2 * (gl_VertexID & 2) - 1, 0, 1); }
