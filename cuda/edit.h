// Puts what an edit changed on the device.
#pragma once

#include <algorithm>
#include <span>

#include "cuda/device/buffer.h"
#include "cuda/kernels/edit.h"

namespace voxspring::cuda {

/// Device memory for values on their way to a kernel; grows by doubling, so that edits seldom allocate.
template <class T>
class Staging {
public:
    /// The values on the device, until the next call: both are ordered by `stream`.
    const T* send(std::span<const T> values, const Stream& stream) {
        if (values.size() > buffer_.size()) buffer_.resize(std::max(values.size(), 2 * buffer_.size()));
        if (!values.empty())
            check(cudaMemcpyAsync(buffer_.data(), values.data(), values.size_bytes(), cudaMemcpyHostToDevice,
                                  stream.get()));
        return buffer_.data();
    }
    std::size_t bytes() const { return buffer_.bytes(); }

private:
    Buffer<T> buffer_;
};

/// Each enqueues one kernel.
template <class Real>
void write_bits(Word<Real>* words, const EditedWord* edited, std::size_t count, const Stream& stream);
/// `count` rows.
template <class Real>
void write_rows(const EditedRows<Real>& rows, std::size_t count, const ListShape& shape,
                std::uint32_t* neighbour, SpringConstants<Real>* constants, const Stream& stream);
template <class Real>
void write_springs(const EditedSpring<Real>* edited, std::size_t count, SpringEnds* ends,
                   SpringConstants<Real>* constants, const Stream& stream);

}  // namespace voxspring::cuda
