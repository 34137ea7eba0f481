#include "backends/gl/storage_buffer.h"

#include <algorithm>

namespace voxspring::gl {

void StorageBuffer::allocate(const Context& context, std::size_t bytes, const std::byte* values) {
    *this = {};  // frees the old buffer first
    if (bytes == 0) return;
    buffer_ = make_buffer(context);
    bytes_ = bytes;
    glNamedBufferStorage(get(), GLsizeiptr(bytes_), values, GL_DYNAMIC_STORAGE_BIT);
    context.check("allocating a storage buffer");
}

void StorageBuffer::upload(const Context& context, std::span<const std::byte> values) {
    if (buffer_.get() == 0 || bytes_ != values.size()) {
        replace(context, values);
        return;
    }
    // Despite barriers, NVIDIA's driver (580.159) lets copies overtake dispatches that read the buffer. So
    // the host waits for these.
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    glFinish();
    glNamedBufferSubData(get(), 0, GLsizeiptr(bytes_), values.data());
}

void StorageBuffer::copy(const Context& context, const StorageBuffer& from) {
    if (bytes_ != from.bytes_) allocate(context, from.bytes_);
    if (bytes_ == 0) return;
    // The host waits because NVIDIA's driver lets copies overtake dispatches (upload()).
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    glFinish();
    glCopyNamedBufferSubData(from.get(), get(), 0, 0, GLsizeiptr(bytes_));
    glFinish();
}

void StorageBuffer::download(std::span<std::byte> values) const {
    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    if (!values.empty()) glGetNamedBufferSubData(get(), 0, GLsizeiptr(values.size()), values.data());
}

}  // namespace voxspring::gl
