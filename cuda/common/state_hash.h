// The hash of arrays in device memory (backends/physics/state_hash.h).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>

#include "backends/layout/state_hash.h"
#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"

namespace voxspring::cuda {

/// Hashes arrays on the device, so that only the sums travel to the host.
class StateHash {
public:
    explicit StateHash(const Stream& stream) : stream_(stream) {
        sums_.resize(layout::HashSums().size());
        sums_.fill_with_zeros(stream);
    }

    template <class T>
    void add(const Buffer<T>& buffer) {
        static_assert(sizeof(T) % sizeof(std::uint32_t) == 0);
        const unsigned number = arrays_++;
        if (buffer.size() == 0) return;
        // So few blocks that one atomic operation per warp costs nothing.
        constexpr std::size_t block = 256, max_blocks = 1024;
        const std::size_t count = buffer.bytes() / sizeof(std::uint32_t);
        const void* const words = buffer.data();
        any_support_kernels().hash_words->launch(
            stream_, dim3(unsigned(std::min(max_blocks, (count + block - 1) / block))), dim3(unsigned(block)),
            0, words, count, number, sums_.data());
    }
    std::string text() const {
        layout::HashSums sums;
        sums_.download(sums, stream_);
        return layout::text_of(sums);
    }

private:
    const Stream& stream_;
    Buffer<std::uint32_t> sums_;
    unsigned arrays_ = 0;
};

}  // namespace voxspring::cuda
