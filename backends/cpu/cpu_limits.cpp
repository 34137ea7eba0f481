// What the processor can do at best, on all cores and in the SIMD registers that cpu_parallel uses.
#include <hwy/aligned_allocator.h>
#include <omp.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <fstream>
#include <string>

#include "backends/cpu/cpu_backend.h"

// As in cpu_parallel.cpp.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backends/cpu/cpu_limits.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Independent sums: as many as two units with a latency of five keep busy. With the two factors they fit
/// into the 16 registers of AVX2.
constexpr std::size_t sums = 10;

/// Runs `count` times `sums` multiply-adds of a register. Returns how many those were of scalars, and leaves
/// in `result` what they came to.
template <class T>
HWY_INLINE std::size_t multiply_add(std::size_t count, T* result) {
    const hn::ScalableTag<T> tag;
    const auto factor = hn::Set(tag, result[0]);
    const auto term = hn::Set(tag, result[1]);
    hn::Vec<decltype(tag)> sum[sums];
    for (std::size_t s = 0; s < sums; ++s) sum[s] = hn::Set(tag, T(s));
    for (std::size_t n = 0; n < count; ++n) {
        for (std::size_t s = 0; s < sums; ++s) sum[s] = hn::MulAdd(sum[s], factor, term);
    }
    for (std::size_t s = 1; s < sums; ++s) sum[0] = hn::Add(sum[0], sum[s]);
    result[1] = hn::GetLane(sum[0]);
    return count * sums * hn::Lanes(tag);
}

std::size_t multiply_add_float32(std::size_t count, float* result) { return multiply_add(count, result); }
std::size_t multiply_add_float64(std::size_t count, double* result) { return multiply_add(count, result); }

/// A pass over arrays that start on a cache line, `count` a multiple of one's elements.
HWY_FLATTEN void overwrite(const float* current, float* previous, std::size_t count) {
    const hn::ScalableTag<float> tag;
    for (std::size_t i = 0; i < count; i += hn::Lanes(tag))
        hn::Store(hn::Sub(hn::Load(tag, current + i), hn::Load(tag, previous + i)), tag, previous + i);
}

}  // namespace
}  // namespace voxspring::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace voxspring {
namespace {

HWY_EXPORT(multiply_add_float32);
HWY_EXPORT(multiply_add_float64);
HWY_EXPORT(overwrite);

std::size_t multiply_add_on_best_target(std::size_t count, float* result) {
    return HWY_DYNAMIC_DISPATCH(multiply_add_float32)(count, result);
}
std::size_t multiply_add_on_best_target(std::size_t count, double* result) {
    return HWY_DYNAMIC_DISPATCH(multiply_add_float64)(count, result);
}

/// Seconds that the slowest thread takes for `work(thread, threads)` once all of them are there. Not since
/// the fork: on a processor shared with others a thread may wait for a core longer than it then works.
template <class Work>
double parallel_seconds(Work work) {
    using Clock = std::chrono::steady_clock;
    double slowest = 0;
#pragma omp parallel reduction(max : slowest)
    {
#pragma omp barrier
        const auto begin = Clock::now();
        work(std::size_t(omp_get_thread_num()), std::size_t(omp_get_num_threads()));
        slowest = std::chrono::duration<double>(Clock::now() - begin).count();
    }
    return slowest;
}

template <class T>
double operations_per_second() {
    constexpr std::size_t repetition = 10000;
    std::atomic<std::size_t> operations = 0;  // of one repetition of all threads
    const double seconds = min_seconds([&](int count) {
        operations = 0;
        return parallel_seconds([&](std::size_t, std::size_t) {
            // Factors that the compiler cannot know. The sums converge to 2.
            volatile T half = T(0.5);
            T result[] = {half, T(1)};
            std::size_t done = 0;
            for (int n = 0; n < count; ++n) done = multiply_add_on_best_target(repetition, result);
            operations += done;
            half = result[1];
        });
    });
    return double(operations) / seconds;
}

/// Of two arrays of `bytes` each.
double bytes_per_second(std::size_t bytes) {
    constexpr std::size_t line = 64 / sizeof(float);
    const std::size_t lines = bytes / sizeof(float) / line;
    const auto current = hwy::AllocateAligned<float>(lines * line);
    const auto previous = hwy::AllocateAligned<float>(lines * line);
    if (current == nullptr || previous == nullptr)
        throw DeviceError("cannot allocate " + std::to_string(2 * bytes) + " bytes");
    // Each thread has the same part every time, and so in its own caches and its own memory.
    const auto on_every_part = [&](auto work) {
        return parallel_seconds([&](std::size_t thread, std::size_t threads) {
            const std::size_t begin = lines * thread / threads * line;
            const std::size_t end = lines * (thread + 1) / threads * line;
            work(current.get() + begin, previous.get() + begin, end - begin);
        });
    };
    on_every_part([](float* a, float* b, std::size_t count) {
        std::fill_n(a, count, 1.0F);
        std::fill_n(b, count, 1.0F);
    });
    const double seconds = min_seconds([&](int repetitions) {
        return on_every_part([&](const float* a, float* b, std::size_t count) {
            for (int n = 0; n < repetitions; ++n) HWY_DYNAMIC_DISPATCH(overwrite)(a, b, count);
        });
    });
    return 3 * double(lines * line * sizeof(float)) / seconds;
}

/// Bytes of the first core's last cache, which Linux gives as "32768K"; 0 where it gives none. Not sysconf(),
/// which in a virtual machine may name all that the host has.
std::size_t last_cache_bytes() {
    std::size_t bytes = 0;
    for (int index = 0;; ++index) {
        std::ifstream file("/sys/devices/system/cpu/cpu0/cache/index" + std::to_string(index) + "/size");
        std::size_t kibibytes = 0;
        char unit = 0;
        if (!(file >> kibibytes >> unit) || unit != 'K') return bytes;
        bytes = std::max(bytes, kibibytes << 10);
    }
}

}  // namespace

DeviceLimits CpuBackend::measure_limits() {
    DeviceLimits limits;
    const std::size_t cache = last_cache_bytes();
    // Four times the cache leaves no line in it until its next use; with a bound where a host has caches
    // that its guests share.
    limits.copy_bytes_per_second =
        bytes_per_second(std::clamp<std::size_t>(2 * cache, std::size_t(64) << 20, std::size_t(256) << 20));
    if (cache != 0) {
        limits.cache_bytes = double(cache);
        limits.cached_copy_bytes_per_second = bytes_per_second(cache / 8);
    }
    limits.float32_operations_per_second = operations_per_second<float>();
    limits.float64_operations_per_second = operations_per_second<double>();
    return limits;
}

}  // namespace voxspring
#endif
