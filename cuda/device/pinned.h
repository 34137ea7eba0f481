// Host memory that the device copies into, or out of, while the host goes on.
#pragma once

#include <span>

#include "cuda/device/buffer.h"
#include "cuda/device/memory.h"

namespace voxspring::cuda {

template <class T>
class Pinned : public Memory<T, cudaMallocHost, cudaFreeHost> {
public:
    /// Takes over the size of `buffer` and enqueues a copy of it.
    void copy(const Buffer<T>& buffer, const Stream& stream) {
        this->resize(buffer.size());
        check(cudaMemcpyAsync(this->data(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost,
                              stream.get()));
    }
    std::span<const T> values() const { return {this->data(), this->size()}; }
};

}  // namespace voxspring::cuda
