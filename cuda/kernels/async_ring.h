// Rings of windows in shared memory that a block's threads fill by asynchronous copies, from compute
// capability 8.0 on. This is device code. The host can run it too if the functions below are provided
// (tests/cuda_march_test.cpp).
#pragma once

#include "cuda/kernels/march.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
/// Begins a copy of `bytes` bytes, at most 16, to shared memory, with zeros up to 16 bytes.
__device__ inline void copy_async(void* to, const void* from, int bytes) {
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16, %2;" ::"r"(
                     static_cast<std::uint32_t>(__cvta_generic_to_shared(to))),
                 "l"(from), "r"(bytes)
                 : "memory");
}
/// Closes a group: all copies that this thread began since it closed the last one.
__device__ inline void end_copies() { asm volatile("cp.async.commit_group;" ::: "memory"); }
/// Waits for this thread's copies, except for its `pending` latest groups.
template <int pending>
__device__ void await_copies() {
    asm volatile("cp.async.wait_group %0;" ::"n"(pending) : "memory");
}
__device__ inline bool any_of_warp(bool here) { return __any_sync(~0U, int(here)) != 0; }
/// Waits for all of a block's threads, which may be in different branches.
template <int threads>
__device__ void meet_block() {
    asm volatile("bar.sync 1, %0;" ::"n"(threads) : "memory");
}
#endif

/// The rings of a block that marches over an item, and where this thread is in them: the `Planes` of march().
/// A plane has arrived once every thread has waited for the copies that it began, and all threads have met.
/// By then no thread works any more on the plane that is two before it, so the slots of that plane are filled
/// anew.
template <class Real, MarchShape shape>
class AsyncRings {
    static constexpr int real = sizeof(Real);
    static constexpr int planes = shape.planes, befores = shape.previous_windows;
    /// A thread's copies form two groups per plane: first what a step overwrites, then positions. This many
    /// groups, those of later planes, may still be under way when a plane arrives.
    static constexpr int pending = planes - 2 <= befores - 1 ? 2 * (planes - 3) : 2 * (befores - 2) + 1;
    static_assert(planes >= 3 && befores >= 2);

public:
    __device__ AsyncRings(unsigned char* shared, const MarchStep<Real>& step, const MarchArrays<Real>& from,
                          const MarchItem& item, int thread)
        : step_(step),
          from_(from),
          item_(item),
          windows_(reinterpret_cast<Real*>(shared)),
          befores_(reinterpret_cast<Real*>(shared + planes * shape.window_bytes(real))),
          thread_(thread),
          first_(item.begin == 0 ? 0 : item.begin - 1),
          arriving_(first_) {
        UNROLLED
        for (int n = 0; n + 1 < planes; ++n) {
            if (n == 1) {
                UNROLLED
                for (int k = 0; k < befores; ++k) fill_before(k, item.begin + k);
            }
            end_copies();
            fill(n, first_ + n);
            end_copies();
        }
    }

    __device__ void refill(int) {}
    __device__ static bool any(bool here) { return any_of_warp(here); }
    __device__ const Real* arrive() {
        await_copies<pending>();
        meet_block<shape.threads()>();
        if (arriving_ > first_) {
            if (arriving_ > item_.begin + 1)
                fill_before(slot_ahead<befores>(before_slot_, befores - 1), arriving_ + befores - 2);
            end_copies();
            fill(slot_ahead<planes>(slot_, planes - 2), arriving_ + planes - 2);
            end_copies();
        }
        const Real* const window = windows_ + slot_ * (shape.window_bytes(real) / real);
        slot_ = slot_ahead<planes>(slot_, 1);
        ++arriving_;
        return window + shape.own(thread_, real);
    }
    __device__ void release() {}
    __device__ const Real* before() {
        // No plane arrives after the lattice's last one, so the old values of that plane are awaited here.
        if (arriving_ == step_.nz && before_plane_ + 1 == item_.end - item_.begin) {
            await_copies<0>();
            meet_block<shape.threads()>();
        }
        return befores_ + before_slot_ * (shape.before_bytes(real) / real) + shape.before_own(thread_);
    }
    static __device__ void store(Pair<Real>* to, Pair<Real> pair) { *to = pair; }
    __device__ void release_before() {
        before_slot_ = slot_ahead<befores>(before_slot_, 1);
        ++before_plane_;
    }

private:
    /// The slot that is `count` slots after `slot` in the ring. `count` is at most `slots`.
    template <int slots>
    static __device__ int slot_ahead(int slot, int count) {
        return slot + count < slots ? slot + count : slot + count - slots;
    }
    __device__ void fill(int slot, int plane) const {
        // The last plane to arrive is the one above the item, if the lattice has one.
        if (plane <= item_.end && plane < step_.nz)
            copy_box<shape.pitch(real), shape.height() + 2>(
                windows_ + slot * (shape.window_bytes(real) / real), from_.positions,
                item_.x - shape.margin(real), item_.y - 1, plane);
    }
    __device__ void fill_before(int slot, int plane) const {
        if (plane < item_.end)
            copy_box<shape.width(), shape.height()>(befores_ + slot * (shape.before_bytes(real) / real),
                                                    from_.before, item_.x, item_.y, plane);
    }
    /// Begins the copies of this thread's pieces, of 16 bytes each, of the box at (x, y, z), for all three
    /// axes. x is a multiple of a piece's elements. Elements outside of the lattice become zeros.
    template <int width, int height>
    __device__ void copy_box(Real* to, const Real* from, int x, int y, int z) const {
        constexpr int piece = 16 / real, across = width / piece, pieces = 3 * height * across;
        UNROLLED
        for (int first = 0; first < pieces; first += shape.threads()) {
            const int n = first + thread_;
            if (first + shape.threads() > pieces && n >= pieces) break;
            const int row = n / across;
            const int i = x + n % across * piece, j = y + row % height, axis = row / height;
            const bool inside = i >= 0 && i < step_.nx && j >= 0 && j < step_.ny;
            // No pointer is formed from an element outside: i and j may be negative there.
            const std::size_t element = std::size_t(axis) * step_.axis + std::size_t(z) * step_.plane +
                                        std::size_t(j) * step_.row + std::size_t(i);
            const int present = step_.nx - i < piece ? step_.nx - i : piece;
            copy_async(to + n * piece, from + (inside ? element : 0), inside ? present * real : 0);
        }
    }

    const MarchStep<Real>& step_;
    const MarchArrays<Real>& from_;
    const MarchItem& item_;
    Real* const windows_;
    Real* const befores_;
    const int thread_, first_;
    int arriving_;  ///< the next plane to arrive
    int slot_ = 0;  ///< the slot of plane `arriving_`
    /// The next plane to step, counted from item.begin, and its slot.
    int before_plane_ = 0, before_slot_ = 0;
};

}  // namespace voxspring::cuda
