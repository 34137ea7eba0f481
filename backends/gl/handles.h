// Owners of GL objects.
#pragma once

#include <epoxy/gl.h>

#include <cstdint>
#include <utility>

#include "backends/gl/context.h"

namespace voxspring::gl {

enum class Object : std::uint8_t { texture, buffer, framebuffer, vertex_array, query, shader, program };

/// Deletes object `name` of the current context.
void destroy(Object kind, GLuint name) noexcept;

/// Owns one object of a context. The context must outlive the handle. Names are unique only within a context,
/// so the destructor makes the object's context current.
template <Object kind>
class Handle {
public:
    Handle() = default;
    Handle(const Context& context, GLuint name) : context_(&context), name_(name) {}
    Handle(Handle&& other) noexcept : context_(other.context_), name_(std::exchange(other.name_, 0)) {}
    Handle& operator=(Handle&& other) noexcept {
        std::swap(context_, other.context_);
        std::swap(name_, other.name_);
        return *this;
    }
    ~Handle() {
        if (name_ != 0 && context_->try_make_current()) destroy(kind, name_);
    }

    GLuint get() const { return name_; }

private:
    const Context* context_ = nullptr;
    GLuint name_ = 0;
};

using Texture = Handle<Object::texture>;
using Buffer = Handle<Object::buffer>;
using Framebuffer = Handle<Object::framebuffer>;
using VertexArray = Handle<Object::vertex_array>;
using Query = Handle<Object::query>;

Buffer make_buffer(const Context& context);
Framebuffer make_framebuffer(const Context& context);
VertexArray make_vertex_array(const Context& context);
Query make_query(const Context& context);

}  // namespace voxspring::gl
