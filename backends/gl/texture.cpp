#include "backends/gl/texture.h"

#include <algorithm>
#include <cstddef>
#include <limits>

namespace voxspring::gl {
namespace {

Texture make(const Context& context, GLenum target) {
    GLuint name = 0;
    glCreateTextures(target, 1, &name);
    // With filtering, an integer texture would count as incomplete and read as zero.
    glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTextureParameteri(name, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return {context, name};
}

}  // namespace

bool fits(const TexelFormat& format, glm::ivec2 size, int layers) {
    const auto internal = GLint(format.internal);
    GLint width = 0;
    if (layers == 0) {
        glTexImage2D(GL_PROXY_TEXTURE_2D, 0, internal, size.x, size.y, 0, format.external, format.type,
                     nullptr);
        glGetTexLevelParameteriv(GL_PROXY_TEXTURE_2D, 0, GL_TEXTURE_WIDTH, &width);
    } else {
        glTexImage3D(GL_PROXY_TEXTURE_2D_ARRAY, 0, internal, size.x, size.y, layers, 0, format.external,
                     format.type, nullptr);
        glGetTexLevelParameteriv(GL_PROXY_TEXTURE_2D_ARRAY, 0, GL_TEXTURE_WIDTH, &width);
    }
    return width != 0;
}

Texture make_texture(const Context& context, const TexelFormat& format, glm::ivec2 size, const void* texels) {
    Texture texture = make(context, GL_TEXTURE_2D);
    glTextureStorage2D(texture.get(), 1, format.internal, size.x, size.y);
    context.check("allocating a texture");
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);  // rows of bytes have no padding
    if (texels != nullptr) {
        glTextureSubImage2D(texture.get(), 0, 0, 0, size.x, size.y, format.external, format.type, texels);
    }
    return texture;
}

Texture make_array_texture(const Context& context, const TexelFormat& format, glm::ivec2 size, int layers,
                           const void* texels) {
    Texture texture = make(context, GL_TEXTURE_2D_ARRAY);
    glTextureStorage3D(texture.get(), 1, format.internal, size.x, size.y, layers);
    context.check("allocating a texture");
    glTextureSubImage3D(texture.get(), 0, 0, 0, 0, size.x, size.y, layers, format.external, format.type,
                        texels);
    return texture;
}

int rows_of_a_read(const TexelFormat& format, int width) {
    return std::max(1, int(std::numeric_limits<GLsizei>::max() / (std::int64_t(width) * format.bytes)));
}

void read_texture(const Texture& texture, const TexelFormat& format, glm::ivec2 size, void* texels,
                  int max_rows) {
    const std::int64_t row_bytes = std::int64_t(size.x) * format.bytes;
    glPixelStorei(GL_PACK_ALIGNMENT, 1);  // rows of bytes have no padding
    auto* to = static_cast<std::byte*>(texels);
    for (int row = 0; row < size.y; row += max_rows) {
        const int rows = std::min(max_rows, size.y - row);
        const auto bytes = GLsizei(rows * row_bytes);
        glGetTextureSubImage(texture.get(), 0, 0, row, 0, size.x, rows, 1, format.external, format.type,
                             bytes, to);
        to += bytes;
    }
}

void copy_texture(const Texture& from, const Texture& to, glm::ivec2 size) {
    glCopyImageSubData(from.get(), GL_TEXTURE_2D, 0, 0, 0, 0, to.get(), GL_TEXTURE_2D, 0, 0, 0, 0, size.x,
                       size.y, 1);
}

Texture make_buffer_texture(const Context& context, const TexelFormat& format, GLuint buffer) {
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_BUFFER, 1, &name);
    Texture texture(context, name);
    glTextureBuffer(name, format.internal, buffer);
    return texture;
}

}  // namespace voxspring::gl
