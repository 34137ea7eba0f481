// Textures used as arrays of numbers: no filtering, one level.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>

#include "backends/gl/handles.h"

namespace voxspring::gl {

/// How a texel is stored, and how the host writes it.
struct TexelFormat {
    GLenum internal;
    GLenum external;
    GLenum type;
    int bytes;
};
inline constexpr TexelFormat rgba32f{GL_RGBA32F, GL_RGBA, GL_FLOAT, 16};
inline constexpr TexelFormat rg32f{GL_RG32F, GL_RG, GL_FLOAT, 8};
inline constexpr TexelFormat r32ui{GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, 4};
/// Stencil without depth, which OpenGL 4.4 and later have.
inline constexpr TexelFormat stencil8{GL_STENCIL_INDEX8, GL_STENCIL_INDEX, GL_UNSIGNED_BYTE, 1};

/// The width and height that every OpenGL 4.5 allows, for estimates made before there is a context.
inline constexpr int guaranteed_texture_size = 16384;

/// Whether the driver would accept such a texture. `layers` 0 means a plain 2D texture. Allocates nothing.
bool fits(const TexelFormat& format, glm::ivec2 size, int layers = 0);

/// A 2D texture, filled row by row from `texels`, or undefined if that is null.
Texture make_texture(const Context& context, const TexelFormat& format, glm::ivec2 size, const void* texels);

/// The most rows of a texture that one read can return, since their bytes are counted in a GLsizei; at least
/// one.
int rows_of_a_read(const TexelFormat& format, int width);

/// Copies a 2D texture's texels to `texels`, row by row, once everything enqueued has run. Each call of GL
/// takes at most `max_rows` rows.
void read_texture(const Texture& texture, const TexelFormat& format, glm::ivec2 size, void* texels,
                  int max_rows);

/// Copies all texels of a 2D texture to another one of the same format and size.
void copy_texture(const Texture& from, const Texture& to, glm::ivec2 size);

/// A texture through which a shader reads `buffer` by index, as texels.
Texture make_buffer_texture(const Context& context, const TexelFormat& format, GLuint buffer);

/// A 2D array texture, filled layer by layer from `texels`.
Texture make_array_texture(const Context& context, const TexelFormat& format, glm::ivec2 size, int layers,
                           const void* texels);

}  // namespace voxspring::gl
