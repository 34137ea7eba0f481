// The blocks of a CUDA launch on the host, with one host thread or one fiber for each device thread, with the
// built-in names and barriers of a device and the functions that kernels call (exchange.h, wait.h, ticks.h).
// Include it before a kernel's body.
#pragma once

#include <sys/mman.h>
#include <ucontext.h>

#include <array>
#include <atomic>
#include <barrier>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
#include <thread>
#include <utility>
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

/// The device threads of a launch as fibers of one host thread: each runs until it waits, and then lets the
/// next one run. A card has tens of thousands of threads, which are too many for a host. AddressSanitizer and
/// ThreadSanitizer would have to be told of every switch; their builds have no fibers.
class HostFibers {
public:
    /// Calls body(shared) in each fiber, with one Shared per block. Returns once all fibers have ended.
    /// `second`: the number of threads that meet at barrier 2.
    template <class Shared, class Body>
    static void run(unsigned blocks, int threads, int second, const Body& body) {
        std::vector<Shared> shared(blocks);
        HostFibers fibers(blocks, unsigned(threads), unsigned(second),
                          [&](unsigned block) { body(shared[block]); });
        fibers.run_all();
    }
    /// The fibers of which one runs now; null on a thread without fibers.
    static HostFibers*& current() {
        static thread_local HostFibers* fibers = nullptr;
        return fibers;
    }
    HostFibers(const HostFibers&) = delete;
    ~HostFibers() { munmap(stacks_, stack_bytes * fibers_.size()); }

    void let_others_run() { swapcontext(&fibers_[now_].context, &scheduler_); }
    void meet(std::size_t number) {
        Fiber& fiber = fibers_[now_];
        Barrier& barrier = barriers_[fiber.block][number];
        if (++barrier.arrived == members_[number]) {
            barrier.arrived = 0;
            ++barrier.generation;
            return;
        }
        fiber.waits_at = &barrier;
        fiber.generation = barrier.generation;
        let_others_run();
        fiber.waits_at = nullptr;
    }

private:
    struct Barrier {
        unsigned arrived = 0, generation = 0;
    };
    struct Fiber {
        ucontext_t context;
        unsigned block = 0, thread = 0;
        const Barrier* waits_at = nullptr;
        unsigned generation = 0;  ///< the barrier's when this fiber came
        bool ended = false;
    };
    static constexpr std::size_t stack_bytes = 1 << 15;  // only touched pages take memory

    HostFibers(unsigned blocks, unsigned threads, unsigned second, std::function<void(unsigned)> body)
        : body_(std::move(body)),
          members_{threads, threads, second},
          barriers_(blocks),
          fibers_(blocks * threads) {
        void* const memory = mmap(nullptr, stack_bytes * fibers_.size(), PROT_READ | PROT_WRITE,
                                  MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (memory == MAP_FAILED) throw std::bad_alloc();
        (void)madvise(memory, stack_bytes * fibers_.size(), MADV_NOHUGEPAGE);  // a stack touches few pages
        stacks_ = static_cast<char*>(memory);
        for (std::size_t n = 0; n < fibers_.size(); ++n) {
            Fiber& fiber = fibers_[n];
            fiber.block = unsigned(n) / threads;
            fiber.thread = unsigned(n) % threads;
            getcontext(&fiber.context);
            fiber.context.uc_stack.ss_sp = stacks_ + n * stack_bytes;
            fiber.context.uc_stack.ss_size = stack_bytes;
            fiber.context.uc_link = &scheduler_;
            makecontext(&fiber.context, begin, 0);
        }
    }
    static void begin() {
        HostFibers& all = *current();
        all.body_(all.fibers_[all.now_].block);
        all.fibers_[all.now_].ended = true;
    }
    void run_all() {
        current() = this;
        gridDim.x = unsigned(barriers_.size());
        bool resumed = true;
        while (std::exchange(resumed, false)) {
            for (now_ = 0; now_ < fibers_.size(); ++now_) {
                const Fiber& fiber = fibers_[now_];
                if (fiber.ended ||
                    (fiber.waits_at != nullptr && fiber.waits_at->generation == fiber.generation))
                    continue;
                threadIdx.x = fiber.thread;
                blockIdx.x = fiber.block;
                resumed = true;
                swapcontext(&scheduler_, &fiber.context);
            }
        }
        current() = nullptr;
        for (const Fiber& fiber : fibers_) {
            if (!fiber.ended)
                throw std::logic_error("a thread of a block waits at a barrier that others pass");
        }
    }

    const std::function<void(unsigned)> body_;
    const std::array<unsigned, 3> members_;
    std::vector<std::array<Barrier, 3>> barriers_;
    std::vector<Fiber> fibers_;
    char* stacks_ = nullptr;
    ucontext_t scheduler_{};
    std::size_t now_ = 0;  ///< the fiber that runs
};

template <int barrier, int threads>
void meet() {
    if (HostFibers* const fibers = HostFibers::current()) return fibers->meet(barrier);
    host_barriers->barrier[barrier].arrive_and_wait();
}

/// Called before each look at a word that another thread writes.
inline void let_others_run() {
    if (HostFibers* const fibers = HostFibers::current()) return fibers->let_others_run();
    std::this_thread::yield();
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
inline TaggedPoint load_word_gpu(const TaggedPoint* from) {
    let_others_run();
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
    let_others_run();
    for (int n = 0; n < 2; ++n) to[n] = __atomic_load_n(from + n, __ATOMIC_RELAXED);
}
inline void write_word(std::uint64_t* to, std::uint64_t word) {
    __atomic_store_n(to, word, __ATOMIC_RELAXED);
}

inline void count_block(std::uint32_t* counted) { __atomic_fetch_add(counted, 1, __ATOMIC_RELEASE); }
inline std::uint32_t read_count(const std::uint32_t* counted) {
    let_others_run();
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
