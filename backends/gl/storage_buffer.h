// OpenGL's buffers for arrays.
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
    /// Replaces the content. If `values` is empty, the buffer is empty afterwards. Values of another size get
    /// new storage. For values of the same size this waits for everything enqueued.
    void upload(const Context& context, std::span<const std::byte> values);
    /// Replaces the content in new storage. Work that is enqueued goes on with the old storage.
    void replace(const Context& context, std::span<const std::byte> values) {
        allocate(context, values.size(), values.data());
    }
    /// Takes new storage. The content is `values`, or undefined if that is null.
    void allocate(const Context& context, std::size_t bytes, const std::byte* values = nullptr);
    /// Copies out the first values, once everything enqueued has run.
    void download(std::span<std::byte> values) const;
    // The next three functions take a std::vector instead of a span of bytes.
    template <class T>
    void upload(const Context& context, const std::vector<T>& values) {
        upload(context, std::as_bytes(std::span(values)));
    }
    template <class T>
    void replace(const Context& context, const std::vector<T>& values) {
        replace(context, std::as_bytes(std::span(values)));
    }
    template <class T>
    void download(std::vector<T>& values) const {
        download(std::as_writable_bytes(std::span(values)));
    }
    /// Copies the content of `from`. The storage is new unless it has the same size.
    void copy(const Context& context, const StorageBuffer& from);
    GLuint get() const { return buffer_.get(); }
    std::size_t bytes() const { return bytes_; }
    void bind(GLuint binding) const { glBindBufferBase(GL_SHADER_STORAGE_BUFFER, binding, get()); }

private:
    Buffer buffer_;
    std::size_t bytes_ = 0;
};

}  // namespace voxspring::gl
