// Does next to nothing, which shows what a draw costs by itself.
layout(location = 0) out vec4 next;
void main() { next = vec4(1); }
