// An array in device memory.
#pragma once

#include <cstddef>
#include <span>
#include <utility>

#include "cuda/device/stream.h"

namespace voxspring::cuda {

template <class T>
class Buffer {
public:
    /// Room for `size` elements with any content; the same memory as before if it had that many.
    void resize(std::size_t size) {
        if (size == size_) return;
        handle_ = {};
        size_ = 0;
        if (size == 0) return;
        void* memory = nullptr;
        check(cudaMalloc(&memory, size * sizeof(T)));
        handle_ = Handle<void*, cudaFree>(memory);
        size_ = size;
    }
    /// resize() to `values` and copy them in; returns when they may change.
    void upload(std::span<const T> values, const Stream& stream) {
        resize(values.size());
        if (values.empty()) return;
        check(cudaMemcpyAsync(data(), values.data(), values.size_bytes(), cudaMemcpyHostToDevice,
                              stream.get()));
        stream.synchronize();
    }
    /// Copy all elements out, after everything enqueued in `stream`.
    void download(std::span<T> values, const Stream& stream) const {
        if (size_ == 0) return;
        check(cudaMemcpyAsync(values.data(), data(), bytes(), cudaMemcpyDeviceToHost, stream.get()));
        stream.synchronize();
    }
    /// More room at the end, filled with zeros; what was there moves along.
    void grow(std::size_t size, const Stream& stream) {
        Buffer larger;
        larger.resize(size);
        check(cudaMemcpyAsync(larger.data(), data(), bytes(), cudaMemcpyDeviceToDevice, stream.get()));
        check(cudaMemsetAsync(larger.data() + size_, 0, larger.bytes() - bytes(), stream.get()));
        stream.synchronize();
        std::swap(handle_, larger.handle_);
        std::swap(size_, larger.size_);
    }
    void fill_with_zeros(const Stream& stream) {
        if (size_ != 0) check(cudaMemsetAsync(data(), 0, bytes(), stream.get()));
    }

    /// Null if empty.
    T* data() const { return static_cast<T*>(handle_.get()); }
    std::size_t size() const { return size_; }
    std::size_t bytes() const { return size_ * sizeof(T); }

private:
    Handle<void*, cudaFree> handle_;
    std::size_t size_ = 0;
};

}  // namespace voxspring::cuda
