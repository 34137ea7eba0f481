// Rings of windows in shared memory, which the tensor copy engine fills while a block works. This is device
// code only.
#pragma once

#include "cuda/kernels/march.h"

namespace voxspring::cuda {

__device__ inline std::uint32_t shared_address(const void* p) {
    return static_cast<std::uint32_t>(__cvta_generic_to_shared(p));
}

/// An mbarrier in shared memory. A phase of it ends once as many threads have arrived as make() was told, and
/// all bytes that they announced have arrived.
struct Barrier {
    std::uint32_t address;

    __device__ void make(int threads) const {
        asm volatile("mbarrier.init.shared.b64 [%0], %1;" ::"r"(address), "r"(threads) : "memory");
    }
    __device__ void arrive() const {
        asm volatile("mbarrier.arrive.shared.b64 _, [%0];" ::"r"(address) : "memory");
    }
    __device__ void arrive_expecting(int bytes) const {
        asm volatile("mbarrier.arrive.expect_tx.shared.b64 _, [%0], %1;" ::"r"(address), "r"(bytes)
                     : "memory");
    }
    /// Waits until the phase of this parity has ended.
    __device__ void wait(std::uint32_t parity) const {
        asm volatile(
            "{\n"
            ".reg .pred done;\n"
            "again: mbarrier.try_wait.parity.shared.b64 done, [%0], %1, 0x989680;\n"
            "@!done bra again;\n"
            "}" ::"r"(address),
            "r"(parity)
            : "memory");
    }
};

/// Tells L2 to keep the first `kept` of every kept_of planes of the lattice, and to evict all others first.
/// If `kept` is 0, L2 is told nothing.
template <int kept>
struct CachePolicy {
    std::uint64_t keep = 0, drop = 0;

    __device__ CachePolicy() {
        if constexpr (kept > 0) {
            asm("createpolicy.fractional.L2::evict_last.b64 %0, 1.0;" : "=l"(keep));
            asm("createpolicy.fractional.L2::evict_first.b64 %0, 1.0;" : "=l"(drop));
        }
    }
    __device__ std::uint64_t of(int plane) const { return plane % kept_of < kept ? keep : drop; }

    __device__ void store(Pair<float>* to, Pair<float> pair, int plane) const {
        if constexpr (kept > 0) {
            asm volatile("st.global.L2::cache_hint.v2.f32 [%0], {%1, %2}, %3;" ::"l"(to), "f"(pair.a),
                         "f"(pair.b), "l"(of(plane))
                         : "memory");
        } else {
            *to = pair;
        }
    }
    __device__ void store(Pair<double>* to, Pair<double> pair, int plane) const {
        if constexpr (kept > 0) {
            asm volatile("st.global.L2::cache_hint.v2.f64 [%0], {%1, %2}, %3;" ::"l"(to), "d"(pair.a),
                         "d"(pair.b), "l"(of(plane))
                         : "memory");
        } else {
            *to = pair;
        }
    }
    /// Begins to copy the box at (x, y, z), for all three axes. `done` counts the bytes that have arrived.
    /// Elements outside of the tensor become zeros.
    __device__ void copy_box(std::uint32_t to, const TensorMap& from, int x, int y, int z,
                             Barrier done) const {
        if constexpr (kept > 0) {
            asm volatile(
                "cp.async.bulk.tensor.4d.shared::cluster.global.tile.mbarrier::complete_tx::bytes"
                ".L2::cache_hint [%0], [%1, {%2, %3, %4, %5}], [%6], %7;" ::"r"(to),
                "l"(&from), "r"(x), "r"(y), "r"(z), "r"(0), "r"(done.address), "l"(of(z))
                : "memory");
        } else {
            asm volatile(
                "cp.async.bulk.tensor.4d.shared::cluster.global.tile.mbarrier::complete_tx::bytes"
                " [%0], [%1, {%2, %3, %4, %5}], [%6];" ::"r"(to),
                "l"(&from), "r"(x), "r"(y), "r"(z), "r"(0), "r"(done.address)
                : "memory");
        }
    }
};

/// A position in a ring: a slot, and the parity of the number of completed rounds through the ring.
template <int slots>
struct RingPlace {
    int slot = 0;
    std::uint32_t parity = 0;

    __device__ void advance() { *this = ahead(1); }
    /// The position `count` slots further on. `count` is at most `slots`.
    __device__ RingPlace ahead(int count) const {
        const int next = slot + count;
        return next < slots ? RingPlace{next, parity} : RingPlace{next - slots, parity ^ 1U};
    }
};

/// A ring of `slots` windows of `bytes` bytes, `stride` apart. One thread fills them, and all warps read
/// them.
template <int slots, int bytes, int stride>
struct WindowRing {
    static constexpr int size = slots * stride;

    std::uint32_t windows, barriers;

    __device__ Barrier full(int slot) const { return {barriers + std::uint32_t(8 * slot)}; }
    __device__ Barrier empty(int slot) const { return {barriers + std::uint32_t(8 * (slots + slot))}; }
    __device__ void make(int warps) const {
        for (int slot = 0; slot < slots; ++slot) {
            full(slot).make(1);
            empty(slot).make(warps);
        }
    }
    template <class Cache>
    __device__ void fill(const Cache& cache, RingPlace<slots> place, const TensorMap& from, int x, int y,
                         int z) const {
        empty(place.slot).wait(place.parity ^ 1U);
        full(place.slot).arrive_expecting(bytes);
        cache.copy_box(windows + std::uint32_t(place.slot * stride), from, x, y, z, full(place.slot));
    }
};

/// The rings of a block that marches over an item, and where this thread is in them: the `Planes` of march().
template <class Real, MarchShape shape, int kept>
class MarchRings {
    static constexpr int real = sizeof(Real);
    using PlaneRing = WindowRing<shape.planes, 3 * shape.axis(real) * real, shape.window_bytes(real)>;
    using BeforeRing =
        WindowRing<shape.previous_windows, 3 * shape.before_axis() * real, shape.before_bytes(real)>;

public:
    __device__ MarchRings(unsigned char* shared, const MarchStep<Real>& step, const TensorMap& positions,
                          const TensorMap& previous_windows, const MarchItem& item)
        : positions_(positions),
          previous_windows_(previous_windows),
          item_(item),
          planes_(step.nz),
          stored_plane_(item.begin) {
        const std::uint32_t address = shared_address(shared);
        const std::uint32_t barriers = address + PlaneRing::size + BeforeRing::size;
        ring_ = {address, barriers};
        before_ring_ = {address + PlaneRing::size, barriers + 16 * shape.planes};
        const int thread = int(threadIdx.x);
        window_ = reinterpret_cast<const Real*>(shared) + shape.own(thread, real);
        before_ = reinterpret_cast<const Real*>(shared + PlaneRing::size) + shape.before_own(thread);
        if (thread == 0) {
            ring_.make(shape.warps());
            before_ring_.make(shape.warps());
            asm volatile("fence.mbarrier_init.release.cluster;" ::: "memory");
        }
        __syncthreads();
        if (thread != 0) return;
        // The last slot of either ring is filled in refill(), which therefore seldom waits for other warps.
        const int first = item.begin == 0 ? 0 : item.begin - 1;
        for (int n = 0; n + 1 < shape.planes; ++n) fill(place_.ahead(n), first + n);
        for (int n = 0; n + 1 < shape.previous_windows; ++n)
            fill_before(before_place_.ahead(n), item.begin + n);
    }

    /// Begins to copy the planes whose slots have become free. To be called before `plane` arrives. Copies
    /// are always the same number of planes ahead of arrivals, so place_ and before_place_ also tell the
    /// slots and parities of copies.
    __device__ void refill(int plane) {
        if (threadIdx.x != 0) return;
        fill(place_.ahead(shape.planes - 2), plane + shape.planes - 2);
        if (plane > item_.begin)
            fill_before(before_place_.ahead(shape.previous_windows - 1), plane + shape.previous_windows - 2);
    }
    __device__ static bool any(bool here) { return __any_sync(~0U, int(here)) != 0; }
    __device__ const Real* arrive() {
        const int slot = place_.slot;
        ring_.full(slot).wait(place_.parity);
        place_.advance();
        return window_ + slot * (shape.window_bytes(real) / real);
    }
    __device__ void release() { release(ring_.empty(place_.ahead(shape.planes - 2).slot)); }
    __device__ const Real* before() {
        before_ring_.full(before_place_.slot).wait(before_place_.parity);
        return before_ + before_place_.slot * (shape.before_bytes(real) / real);
    }
    __device__ void store(Pair<Real>* to, Pair<Real> pair) const { cache_.store(to, pair, stored_plane_); }
    __device__ void release_before() {
        release(before_ring_.empty(before_place_.slot));
        before_place_.advance();
        ++stored_plane_;
    }

private:
    __device__ static void release(Barrier empty) {
        __syncwarp();
        if (threadIdx.x % 32 == 0) empty.arrive();
    }
    __device__ void fill(RingPlace<shape.planes> place, int plane) const {
        // The last plane to arrive is the one above the item, if the lattice has one.
        if (plane <= item_.end && plane < planes_)
            ring_.fill(cache_, place, positions_, item_.x - shape.margin(real), item_.y - 1, plane);
    }
    __device__ void fill_before(RingPlace<shape.previous_windows> place, int plane) const {
        if (plane < item_.end) before_ring_.fill(cache_, place, previous_windows_, item_.x, item_.y, plane);
    }

    const TensorMap& positions_;
    const TensorMap& previous_windows_;
    const MarchItem& item_;
    PlaneRing ring_;
    BeforeRing before_ring_;
    const Real* window_;
    const Real* before_;
    CachePolicy<kept> cache_;
    int planes_;        ///< planes of the lattice
    int stored_plane_;  ///< the plane that the next stores belong to
    RingPlace<shape.planes> place_;
    RingPlace<shape.previous_windows> before_place_;
};

}  // namespace voxspring::cuda
