#include "backends/gl/handles.h"

namespace voxspring::gl {

void destroy(Object kind, GLuint name) noexcept {
    if (kind == Object::shader) return glDeleteShader(name);
    if (kind == Object::program) return glDeleteProgram(name);
    const auto destroy_some = kind == Object::texture       ? glDeleteTextures
                              : kind == Object::buffer      ? glDeleteBuffers
                              : kind == Object::framebuffer ? glDeleteFramebuffers
                              : kind == Object::query       ? glDeleteQueries
                                                            : glDeleteVertexArrays;
    destroy_some(1, &name);
}

namespace {

GLuint one(void (*create)(GLsizei, GLuint*)) {
    GLuint name = 0;
    create(1, &name);
    return name;
}

}  // namespace

Buffer make_buffer(const Context& context) { return {context, one(glCreateBuffers)}; }
Framebuffer make_framebuffer(const Context& context) { return {context, one(glCreateFramebuffers)}; }
VertexArray make_vertex_array(const Context& context) { return {context, one(glCreateVertexArrays)}; }
// glCreateQueries() is not used: in Mesa 22.3 it refuses the targets of ARB_pipeline_statistics_query.
Query make_query(const Context& context) { return {context, one(glGenQueries)}; }

}  // namespace voxspring::gl
