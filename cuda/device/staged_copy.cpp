#include "cuda/device/staged_copy.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "backends/backend.h"
#include "cuda/device/memory.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {
namespace {

constexpr std::size_t piece_bytes = std::size_t(1) << 25;
/// Copies of fewer bytes need no pieces (Piece), so a program that makes only such copies allocates none.
constexpr std::size_t large = 2 * piece_bytes;

struct Piece {
    Memory<std::byte, cudaMallocHost, cudaFreeHost> memory;
    Event copied;  ///< recorded after the latest copy between `memory` and the device
};

using Pieces = std::array<Piece, 2>;

/// Returns null if no pinned memory can be allocated.
Pieces* make_pieces() {
    auto both = std::make_unique<Pieces>();
    try {
        for (Piece& piece : *both) piece.memory.resize(piece_bytes);
    } catch (const DeviceError&) {
        both.reset();
    }
    return both.release();
}

/// The two pieces of one copy on the current device. The device copies one piece while the host copies the
/// other. Each device has its pieces, since a stream can record only events of its device. Pieces are used
/// again by later copies of any thread, so there are as many as copies at the same time. They are never
/// freed, because at the end of the process the driver may be gone.
class StagedCopy {
public:
    StagedCopy() {
        check(cudaGetDevice(&device_));
        {
            const std::scoped_lock lock(mutex());
            std::vector<Pieces*>& here = idle()[device_];
            if (!here.empty()) {
                pieces_ = here.back();
                here.pop_back();
            }
        }
        if (pieces_ == nullptr) pieces_ = make_pieces();
    }
    /// Null if make_pieces() returned null.
    Pieces* pieces() const { return pieces_; }
    /// Lets other copies use the pieces. After a failed copy it is not called, since the device may still
    /// read or write them.
    void end() const {
        const std::scoped_lock lock(mutex());
        idle()[device_].push_back(pieces_);
    }

private:
    static std::mutex& mutex() {
        static auto& only = *new std::mutex;
        return only;
    }
    static std::map<int, std::vector<Pieces*>>& idle() {  // by device number
        static auto& all = *new std::map<int, std::vector<Pieces*>>;
        return all;
    }

    int device_ = 0;
    Pieces* pieces_ = nullptr;
};

void copy_on_all_cores(std::byte* to, const std::byte* from, std::size_t bytes) {
    constexpr std::size_t share = std::size_t(1) << 20;
#pragma omp parallel for schedule(static)
    for (std::ptrdiff_t n = 0; n < std::ptrdiff_t((bytes + share - 1) / share); ++n) {
        const std::size_t at = std::size_t(n) * share;
        std::memcpy(to + at, from + at, std::min(share, bytes - at));
    }
}

void copy_whole(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind, const Stream& stream) {
    check(cudaMemcpyAsync(to, from, bytes, kind, stream.get()));
    stream.synchronize();
}

std::size_t bytes_at(std::size_t offset, std::size_t bytes) { return std::min(piece_bytes, bytes - offset); }

}  // namespace

void copy_to_device(void* to, const void* from, std::size_t bytes, const Stream& stream) {
    if (bytes < large) return copy_whole(to, from, bytes, cudaMemcpyHostToDevice, stream);
    const StagedCopy copy;
    Pieces* const staged = copy.pieces();
    if (staged == nullptr) return copy_whole(to, from, bytes, cudaMemcpyHostToDevice, stream);
    auto* const device = static_cast<std::byte*>(to);
    const auto* const host = static_cast<const std::byte*>(from);
    for (std::size_t offset = 0, n = 0; offset < bytes; offset += piece_bytes, ++n) {
        Piece& piece = (*staged)[n % 2];
        if (n >= 2) piece.copied.wait();
        copy_on_all_cores(piece.memory.data(), host + offset, bytes_at(offset, bytes));
        check(cudaMemcpyAsync(device + offset, piece.memory.data(), bytes_at(offset, bytes),
                              cudaMemcpyHostToDevice, stream.get()));
        piece.copied.record(stream);
    }
    stream.synchronize();
    copy.end();
}

void copy_from_device(void* to, const void* from, std::size_t bytes, const Stream& stream) {
    if (bytes < large) return copy_whole(to, from, bytes, cudaMemcpyDeviceToHost, stream);
    const StagedCopy copy;
    Pieces* const staged = copy.pieces();
    if (staged == nullptr) return copy_whole(to, from, bytes, cudaMemcpyDeviceToHost, stream);
    auto* const host = static_cast<std::byte*>(to);
    const auto* const device = static_cast<const std::byte*>(from);
    const auto fetch = [&](std::size_t offset) {
        Piece& piece = (*staged)[offset / piece_bytes % 2];
        check(cudaMemcpyAsync(piece.memory.data(), device + offset, bytes_at(offset, bytes),
                              cudaMemcpyDeviceToHost, stream.get()));
        piece.copied.record(stream);
    };
    fetch(0);
    for (std::size_t offset = 0; offset < bytes; offset += piece_bytes) {
        if (offset + piece_bytes < bytes) fetch(offset + piece_bytes);
        Piece& piece = (*staged)[offset / piece_bytes % 2];
        piece.copied.wait();
        copy_on_all_cores(host + offset, piece.memory.data(), bytes_at(offset, bytes));
    }
    copy.end();
}

}  // namespace voxspring::cuda
