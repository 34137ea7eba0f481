// The blocks of a CUDA launch on the host, with one host thread for each device thread, with the built-in
// names and barriers of a device and the functions that kernels call (exchange.h, wait.h, ticks.h). Include
// it before a kernel's body.
#pragma once

#include <array>
#include <atomic>
#include <barrier>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "backends/layout/records/resident.h"
#include "cuda/kernels/layout.h"

#define __device__

struct HostIndex {
    unsigned x = 0;
};
inline thread_local HostIndex threadIdx, blockIdx, gridDim;

namespace voxspring::cuda {

/// The hardware's barriers 0 to 2, with the number of threads of each.
struct HostBarriers {
    HostBarriers(int all, int first, int second)
        : barrier{std::barrier(all), std::barrier(first), std::barrier(second)} {}
    std::array<std::barrier<>, 3> barrier;
};
inline thread_local HostBarriers* host_barriers = nullptr;

template <int barrier, int threads>
void meet() {
    host_barriers->barrier[barrier].arrive_and_wait();
}

/// A lock per word makes reads and writes of its 16 bytes atomic.
inline std::mutex& mutex_of(const TaggedPoint* word) {
    static std::array<std::mutex, 64> all;
    return all[reinterpret_cast<std::uintptr_t>(word) / sizeof(TaggedPoint) % all.size()];
}
inline void publish_if(bool here, TaggedPoint* to, Vector<float> point, std::uint32_t tag) {
    if (!here) return;
    const std::lock_guard lock(mutex_of(to));
    *to = {point, tag};
}
/// A thread that looks in vain lets others run.
inline TaggedPoint load_word_gpu(const TaggedPoint* from) {
    std::this_thread::yield();
    const std::lock_guard lock(mutex_of(from));
    return *from;
}

/// The part of a body that this thread steps, and the part whose threads delay their first look for points.
inline thread_local int host_rank = 0;
inline std::atomic<int> late_rank = -1;

/// On the host, words that cross devices lie in the same memory as all others.
inline void store_word_system(TaggedPoint* to, Vector<float> point, std::uint32_t tag) {
    publish_if(true, to, point, tag);
}
inline TaggedPoint load_word_system(const TaggedPoint* from) {
    static thread_local bool has_looked = false;
    // Longer than the host takes to launch the threads of another part.
    if (!has_looked && host_rank == late_rank) std::this_thread::sleep_for(std::chrono::milliseconds(100));
    has_looked = true;
    return load_word_gpu(from);
}

/// The block whose looks for an order are slow.
inline std::atomic<unsigned> slow_block = ~0U;

inline void read_words(const std::uint64_t* from, std::uint64_t* to) {
    if (blockIdx.x == slow_block) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    std::this_thread::yield();
    for (int n = 0; n < 2; ++n) to[n] = __atomic_load_n(from + n, __ATOMIC_RELAXED);
}
inline void write_word(std::uint64_t* to, std::uint64_t word) {
    __atomic_store_n(to, word, __ATOMIC_RELAXED);
}

inline void count_block(std::uint32_t* counted) { __atomic_fetch_add(counted, 1, __ATOMIC_RELEASE); }
inline std::uint32_t read_count(const std::uint32_t* counted) {
    std::this_thread::yield();
    return __atomic_load_n(counted, __ATOMIC_ACQUIRE);
}
inline constexpr std::uint32_t looks_between_clocks = 64;
inline std::uint64_t read_mark(const std::uint64_t* stall) {
    return __atomic_load_n(stall, __ATOMIC_RELAXED);
}
inline void write_mark(std::uint64_t* stall, std::uint64_t mark) {
    __atomic_store_n(stall, mark, __ATOMIC_RELAXED);
}
inline std::uint64_t nanoseconds() {
    return std::uint64_t(std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1));
}

/// The threads of a launch. Its destructor waits for them.
class HostLaunch {
public:
    /// Each thread calls body(shared), with one Shared per block. `second`: the number of threads that meet
    /// at barrier 2.
    template <class Shared, class Body>
    static HostLaunch of(unsigned blocks, int threads, int second, Body body) {
        HostLaunch launch;
        for (unsigned b = 0; b < blocks; ++b) {
            const auto barriers = std::make_shared<HostBarriers>(threads, threads, second);
            const auto shared = std::make_shared<Shared>();
            for (unsigned t = 0; t < unsigned(threads); ++t) {
                launch.threads_.emplace_back([=] {
                    threadIdx.x = t;
                    blockIdx.x = b;
                    gridDim.x = blocks;
                    host_barriers = barriers.get();
                    body(*shared);
                });
            }
        }
        return launch;
    }

private:
    std::vector<std::jthread> threads_;
};

}  // namespace voxspring::cuda

inline void __syncthreads() { voxspring::cuda::meet<0, 0>(); }
