// A barrier for threads that may share their cores with other processes.
#pragma once

#include <atomic>
#include <thread>

namespace voxspring::cpu_parallel {

/// The meeting point of the threads of a step. OpenMP's barrier spins for milliseconds. If another process
/// has one of the cores, such spinning can keep the very thread that the others wait for from running. Each
/// step then costs a time slice of the scheduler (4 ms). This barrier spins for some microseconds and then
/// lets others run.
class Barrier {
public:
    /// To be called before any thread waits.
    void expect(int threads) { threads_ = threads; }
    void wait() {
        const unsigned phase = phase_.load(std::memory_order_acquire);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 == threads_) {
            arrived_.store(0, std::memory_order_relaxed);
            phase_.store(phase + 1, std::memory_order_release);
            return;
        }
        for (int spins = 0; phase_.load(std::memory_order_acquire) == phase; ++spins) {
            if (spins >= max_spins) std::this_thread::yield();
        }
    }

private:
    static constexpr int max_spins = 2000;  // loads of phase_ before the thread yields

    int threads_ = 0;
    // Each counter has a separate cache line: a thread that arrives does not disturb those that wait.
    alignas(64) std::atomic<int> arrived_ = 0;
    alignas(64) std::atomic<unsigned> phase_ = 0;
};

}  // namespace voxspring::cpu_parallel
