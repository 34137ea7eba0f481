// Host memory that the device copies into while the host goes on.
#pragma once

#include <span>

#include "cuda/device/buffer.h"

namespace voxspring::cuda {

template <class T>
class Pinned {
public:
    /// Enqueues a copy of `buffer`, whose size this takes over.
    void copy(const Buffer<T>& buffer, const Stream& stream) {
        if (buffer.size() != size_) {
            handle_ = {};
            size_ = 0;
            void* memory = nullptr;
            check(cudaMallocHost(&memory, buffer.bytes()));
            handle_ = Handle<void*, cudaFreeHost>(memory);
            size_ = buffer.size();
        }
        check(cudaMemcpyAsync(handle_.get(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost,
                              stream.get()));
    }
    std::span<const T> values() const { return {static_cast<const T*>(handle_.get()), size_}; }

private:
    Handle<void*, cudaFreeHost> handle_;
    std::size_t size_ = 0;
};

}  // namespace voxspring::cuda
