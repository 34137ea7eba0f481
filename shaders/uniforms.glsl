// Numbers that the host sets by name: uniforms in OpenGL; in Vulkan members of blocks, with one block per
// file that has such numbers.
#ifdef VULKAN
#define UNIFORMS(name, place) layout(std140, binding = place) uniform name {
#define UNIFORM
#define END_UNIFORMS \
    }                \
    ;
#else
#define UNIFORMS(name, place)
#define UNIFORM uniform
#define END_UNIFORMS
#endif
