// Host memory that the device copies into, or out of, while the host goes on.
#pragma once

#include <span>

#include "cuda/device/buffer.h"

namespace voxspring::cuda {

template <class T>
class Pinned {
public:
    /// Enqueues a copy of `buffer`, whose size this takes over.
    void copy(const Buffer<T>& buffer, const Stream& stream) {
        resize(buffer.size());
        check(cudaMemcpyAsync(handle_.get(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost,
                              stream.get()));
    }
    /// Room for `size` elements with any content; the same memory as before if it had that many.
    void resize(std::size_t size) {
        if (size == size_) return;
        handle_ = {};
        size_ = 0;
        if (size == 0) return;
        void* memory = nullptr;
        check(cudaMallocHost(&memory, size * sizeof(T)));
        handle_ = Handle<void*, cudaFreeHost>(memory);
        size_ = size;
    }
    /// Null if empty.
    T* data() const { return static_cast<T*>(handle_.get()); }
    std::size_t size() const { return size_; }
    std::span<const T> values() const { return {data(), size_}; }

private:
    Handle<void*, cudaFreeHost> handle_;
    std::size_t size_ = 0;
};

}  // namespace voxspring::cuda
