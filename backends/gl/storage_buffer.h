// Arrays in device memory that shaders read and write.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/handles.h"

namespace voxspring::gl {

/// An array in device memory for shaders to read and write.
class StorageBuffer {
public:
    /// Replaces what it held, if anything; nothing if `values` are empty. Waits for all that is enqueued, or
    /// takes new storage.
    template <class T>
    void upload(const Context& context, const std::vector<T>& values) {
        upload(context, std::as_bytes(std::span(values)));
    }
    /// The same in new storage: what is enqueued goes on with the old.
    template <class T>
    void replace(const Context& context, const std::vector<T>& values) {
        replace(context, std::as_bytes(std::span(values)));
    }
    /// The first values.size() of them, once everything enqueued has run.
    template <class T>
    void download(std::vector<T>& values) const {
        download(std::as_writable_bytes(std::span(values)));
    }
    /// Holds what `from` holds, in new storage unless it was of that size.
    void copy(const Context& context, const StorageBuffer& from);
    GLuint get() const { return buffer_.get(); }
    std::size_t bytes() const { return bytes_; }
    void bind(GLuint binding) const { glBindBufferBase(GL_SHADER_STORAGE_BUFFER, binding, get()); }

private:
    void upload(const Context& context, std::span<const std::byte> values);
    void replace(const Context& context, std::span<const std::byte> values);
    void download(std::span<std::byte> values) const;

    Buffer buffer_;
    std::size_t bytes_ = 0;
};

}  // namespace voxspring::gl
