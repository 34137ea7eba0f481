// A hash of arrays in device memory.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "backends/disk_cache.h"
#include "cuda/device/buffer.h"

namespace voxspring::cuda {

/// Hashes arrays piece by piece, so that no large memory is needed on the host: to allocate that takes
/// several times as long as the transfer.
class BufferHash {
public:
    explicit BufferHash(const Stream& stream) : stream_(stream) {}

    template <class T>
    void add(const Buffer<T>& buffer) {
        constexpr std::size_t most = std::size_t(64) << 20;
        piece_.resize(std::max(piece_.size(), std::min(most, buffer.bytes())));
        const auto* const data = reinterpret_cast<const std::byte*>(buffer.data());
        for (std::size_t done = 0; done < buffer.bytes();) {
            const std::size_t bytes = std::min(most, buffer.bytes() - done);
            copy_from_device(piece_.data(), data + done, bytes, stream_);
            hash_.add(piece_.data(), bytes);
            done += bytes;
        }
    }
    std::string text() const { return hash_.text(); }

private:
    const Stream& stream_;
    std::vector<std::byte> piece_;
    Hash hash_;
};

}  // namespace voxspring::cuda
