#include "backends/gl/handles.h"

namespace voxspring::gl {

void destroy(Object kind, GLuint name) noexcept {
    switch (kind) {
        case Object::texture:
            glDeleteTextures(1, &name);
            break;
        case Object::buffer:
            glDeleteBuffers(1, &name);
            break;
        case Object::framebuffer:
            glDeleteFramebuffers(1, &name);
            break;
        case Object::vertex_array:
            glDeleteVertexArrays(1, &name);
            break;
        case Object::query:
            glDeleteQueries(1, &name);
            break;
        case Object::shader:
            glDeleteShader(name);
            break;
        case Object::program:
            glDeleteProgram(name);
            break;
    }
}

Buffer make_buffer(const Context& context) {
    GLuint name = 0;
    glCreateBuffers(1, &name);
    return {context, name};
}

Framebuffer make_framebuffer(const Context& context) {
    GLuint name = 0;
    glCreateFramebuffers(1, &name);
    return {context, name};
}

VertexArray make_vertex_array(const Context& context) {
    GLuint name = 0;
    glCreateVertexArrays(1, &name);
    return {context, name};
}

Query make_query(const Context& context) {
    GLuint name = 0;
    // glCreateQueries does not work here: in Mesa 22.3 it refuses the targets of
    // ARB_pipeline_statistics_query.
    glGenQueries(1, &name);
    return {context, name};
}

}  // namespace voxspring::gl
