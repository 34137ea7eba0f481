// An array of memory that CUDA allocates, on the device or on the host.
#pragma once

#include <cstddef>

#include "cuda/device/check.h"
#include "cuda/device/handle.h"

namespace voxspring::cuda {

/// `allocate` and `free` are cudaMalloc and cudaFree, or cudaMallocHost and cudaFreeHost.
template <class T, cudaError_t (*allocate)(void**, std::size_t), cudaError_t (*free)(void*)>
class Memory {
public:
    /// Makes room for `size` elements, whose values are undefined. If the size is the same as before, memory
    /// and values stay.
    void resize(std::size_t size) {
        if (size == size_) return;
        handle_ = {};
        size_ = 0;
        if (size == 0) return;
        void* memory = nullptr;
        check(allocate(&memory, size * sizeof(T)));
        handle_ = Handle<void*, free>(memory);
        size_ = size;
    }

    /// Null if the size is 0.
    T* data() const { return static_cast<T*>(handle_.get()); }
    std::size_t size() const { return size_; }
    std::size_t bytes() const { return size_ * sizeof(T); }

private:
    Handle<void*, free> handle_;
    std::size_t size_ = 0;
};

}  // namespace voxspring::cuda
