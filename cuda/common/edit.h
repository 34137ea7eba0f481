// Writes to the device what an edit of springs has changed.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <span>
#include <vector>

#include "backends/layout/neighbour_lists.h"
#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/edit.h"

namespace voxspring::cuda {

/// Copies `from`, at most max_argument_bytes, to `to` in device memory. `to` is aligned to 16 bytes, and has
/// room for that many bytes rounded up to a multiple of 16. Enqueues one kernel, which gets the bytes as an
/// argument. So `from` may be changed at once, and no step waits for the copy engine, which would take longer
/// than many edits do.
void send_as_argument(std::byte* to, std::span<const std::byte> from, const Stream& stream);

/// Memory for values on their way to a kernel; grows by doubling, so that edits seldom allocate.
template <class T>
class Staging {
public:
    /// Copies `values` to the device and returns their address there, which is valid for work enqueued in
    /// `stream` before the next call. `values` may be changed at once. More than max_argument_bytes go
    /// through the next of `slots_`; the call first waits until the device has fetched what that slot held.
    const T* send(std::span<const T> values, const Stream& stream) {
        if (values.empty()) return buffer_.data();
        constexpr std::size_t word = 16;
        const std::size_t room = (values.size_bytes() + word - 1) / word * word;
        grow(buffer_, (room + sizeof(T) - 1) / sizeof(T));
        if (values.size_bytes() <= max_argument_bytes) {
            send_as_argument(reinterpret_cast<std::byte*>(buffer_.data()), std::as_bytes(values), stream);
        } else {
            copy_from_pinned(values, stream);
        }
        return buffer_.data();
    }
    /// The address that send() returns. It can change only if a call sends more values than all calls before.
    const T* data() const { return buffer_.data(); }
    std::size_t bytes() const { return buffer_.bytes(); }

private:
    struct Slot {
        Pinned<T> pinned;
        Event sent;  ///< recorded after the copy from `pinned`
        bool pending = false;
    };

    void copy_from_pinned(std::span<const T> values, const Stream& stream) {
        Slot& slot = slots_[next_];
        next_ = (next_ + 1) % slots_.size();
        if (slot.pending) slot.sent.wait();
        grow(slot.pinned, values.size());
        std::copy(values.begin(), values.end(), slot.pinned.data());
        check(cudaMemcpyAsync(buffer_.data(), slot.pinned.data(), values.size_bytes(), cudaMemcpyHostToDevice,
                              stream.get()));
        slot.sent.record(stream);
        slot.pending = true;
    }

    template <class Memory>
    static void grow(Memory& memory, std::size_t size) {
        if (size > memory.size()) memory.resize(std::max(size, 2 * memory.size()));
    }

    Buffer<T> buffer_;
    std::array<Slot, 8> slots_;  ///< used in turns
    std::size_t next_ = 0;
};

/// Sends the edited lists of some particles to the device in one copy, for write_rows().
template <class Real>
class StagedRows {
public:
    /// Returns the addresses of the lists on the device. `squared`: whether rest lengths are squares.
    EditedRows<Real> send(const EditedLists<Real>& edited, bool squared, const Stream& stream) {
        bytes_.clear();
        const std::size_t particle = append(edited.particle), bits = append(edited.lists.bits);
        const std::size_t neighbour = append(edited.lists.neighbour),
                          constants = append(edited.lists.constants),
                          off_lattice_rest = append(edited.lists.off_lattice_rest);
        const std::byte* on_device = staging_.send(std::span<const std::byte>(bytes_), stream);
        const auto at = [&]<class T>(const std::vector<T>& values, std::size_t offset) {
            return values.empty() ? nullptr : reinterpret_cast<const T*>(on_device + offset);
        };
        return {at(edited.particle, particle),
                at(edited.lists.bits, bits),
                at(edited.lists.neighbour, neighbour),
                at(edited.lists.constants, constants),
                at(edited.lists.off_lattice_rest, off_lattice_rest),
                squared};
    }
    std::size_t bytes() const { return staging_.bytes(); }

private:
    template <class T>
    std::size_t append(const std::vector<T>& values) {
        constexpr std::size_t alignment = 16;
        const std::size_t offset = (bytes_.size() + alignment - 1) / alignment * alignment;
        bytes_.resize(offset + values.size() * sizeof(T));
        if (!values.empty()) std::memcpy(bytes_.data() + offset, values.data(), values.size() * sizeof(T));
        return offset;
    }

    std::vector<std::byte> bytes_;
    Staging<std::byte> staging_;
};

/// Enqueues a kernel that writes `count` rows (a row: the list of one particle, or a column of a slice) and,
/// unless `words` is null, the bits of their particles.
template <class Real>
void write_rows(const EditedRows<Real>& rows, std::size_t count, const ListShape& shape,
                ParticleRecord<Real>* words, std::uint32_t* neighbour, SpringConstants<Real>* constants,
                SpringRest<Real>* off_lattice_rest, const Stream& stream) {
    const std::size_t slots = count * shape.slots;
    launch_for_each(*support_kernels<Real>().write_rows, slots, stream, rows, slots, shape, words, neighbour,
                    constants, off_lattice_rest);
}

}  // namespace voxspring::cuda
