// Host memory to and from which the device copies while the host goes on.
#pragma once

#include <span>

#include "cuda/device/buffer.h"
#include "cuda/device/memory.h"

namespace voxspring::cuda {

template <class T>
class Pinned : public Memory<T, cudaMallocHost, cudaFreeHost> {
public:
    /// Takes the size of `buffer` and enqueues a copy of its elements to this memory.
    void copy(const Buffer<T>& buffer, const Stream& stream) {
        this->resize(buffer.size());
        check(cudaMemcpyAsync(this->data(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost,
                              stream.get()));
    }
    std::span<const T> values() const { return {this->data(), this->size()}; }
};

}  // namespace voxspring::cuda
