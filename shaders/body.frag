// A lit surface whose colours show the values at its points: soft light from the sky, a lamp from the upper
// left, and a trace of gloss.
in vec3 surface_normal;
in float surface_value;

uniform vec4 colours[KNOTS];  // colours of KNOTS equidistant values from 0 to 1

out vec4 colour;

void main() {
    float size = length(surface_normal);
    // The size is 0 where the body has collapsed or where normals cancel.
    vec3 normal = size > 0 ? surface_normal / size : vec3(0, 0, 1);
    if (!gl_FrontFacing) normal = -normal;  // the inside of a cut, or a voxel turned inside out
    const vec3 lamp = normalize(vec3(-0.35, 0.55, 0.75));
    float sky = 0.5 + 0.5 * normal.y;
    float direct = max(dot(normal, lamp), 0);
    float gloss = pow(max(dot(normal, normalize(lamp + vec3(0, 0, 1))), 0), 30);

    float place = clamp(surface_value, 0, 1) * float(KNOTS - 1);
    int below = min(int(place), KNOTS - 2);
    vec3 base = mix(colours[below].rgb, colours[below + 1].rgb, place - float(below));
    colour = vec4(base * (0.55 + 0.2 * sky + 0.3 * direct) + vec3(0.12 * gloss), 1);
}
