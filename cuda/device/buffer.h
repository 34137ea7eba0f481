// Arrays in device memory, and arrays in pinned host memory.
#pragma once

#include <cstddef>
#include <span>
#include <utility>

#include "cuda/device/memory.h"
#include "cuda/device/staged_copy.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// An array in device memory.
template <class T>
class Buffer : public Memory<T, cudaMalloc, cudaFree> {
public:
    /// Resizes this array to `values` and copies these to the device. Returns once the caller may change
    /// `values`.
    void upload(std::span<const T> values, const Stream& stream) {
        this->resize(values.size());
        if (!values.empty()) copy_to_device(this->data(), values.data(), values.size_bytes(), stream);
    }
    /// Waits for everything enqueued in `stream` and copies all elements to `values`. Does nothing if there
    /// are none.
    void download(std::span<T> values, const Stream& stream) const {
        if (this->size() != 0) copy_from_device(values.data(), this->data(), this->bytes(), stream);
    }
    /// Enlarges this array to `size` elements, in new memory. Keeps the elements that it has. The elements
    /// added at the end are zero.
    void grow(std::size_t size, const Stream& stream) {
        Buffer larger;
        larger.resize(size);
        const std::size_t bytes = this->bytes();
        check(cudaMemcpyAsync(larger.data(), this->data(), bytes, cudaMemcpyDeviceToDevice, stream.get()));
        check(cudaMemsetAsync(larger.data() + this->size(), 0, larger.bytes() - bytes, stream.get()));
        stream.synchronize();
        std::swap(*this, larger);
    }
    void fill_with_zeros(const Stream& stream) {
        if (this->size() != 0) check(cudaMemsetAsync(this->data(), 0, this->bytes(), stream.get()));
    }
};

/// An array in pinned (page-locked) host memory, which the device reads and writes while the host goes on.
template <class T>
class Pinned : public Memory<T, cudaMallocHost, cudaFreeHost> {
public:
    /// Resizes this array to `buffer` and enqueues a copy of the elements of `buffer` to it.
    void copy(const Buffer<T>& buffer, const Stream& stream) {
        this->resize(buffer.size());
        check(cudaMemcpyAsync(this->data(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost,
                              stream.get()));
    }
    std::span<const T> values() const { return {this->data(), this->size()}; }
};

}  // namespace voxspring::cuda
