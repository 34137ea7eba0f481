// An array in device memory.
#pragma once

#include <cstddef>
#include <span>
#include <utility>

#include "cuda/device/memory.h"
#include "cuda/device/staged_copy.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

template <class T>
class Buffer : public Memory<T, cudaMalloc, cudaFree> {
public:
    /// Resizes to `values` and copies them in. Returns once `values` may change.
    void upload(std::span<const T> values, const Stream& stream) {
        this->resize(values.size());
        if (!values.empty()) copy_to_device(this->data(), values.data(), values.size_bytes(), stream);
    }
    /// Copies all elements out, after everything enqueued in `stream`.
    void download(std::span<T> values, const Stream& stream) const {
        if (this->size() != 0) copy_from_device(values.data(), this->data(), this->bytes(), stream);
    }
    /// Adds room at the end, filled with zeros. The elements move to the new memory.
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

}  // namespace voxspring::cuda
