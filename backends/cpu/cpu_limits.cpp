// Measures what the processor can do at best, on all cores and in the SIMD registers that cpu_parallel uses.
#include <hwy/aligned_allocator.h>
#include <hwy/cache_control.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <fstream>
#include <string>
#include <vector>

#include "backends/cpu/cpu_backend.h"

// These SIMD targets are left out: the compiler's types for their registers have no fixed size, so arrays of
// them cannot be made.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backends/cpu/cpu_limits.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// How many sums run side by side: enough for two multiply-adds per cycle with a latency of five cycles, and
/// for two multiply-adds and two additions per cycle if a sum waits seven cycles for both. With `factor` and
/// `term` they fit into the 16 registers of AVX2.
constexpr std::size_t sums = 14;

/// Runs `sums` multiply-adds of a register, `count` times, with result[0] as factor and result[1] as term; if
/// `with_additions`, each is followed by an addition. Returns the number of scalar operations. Puts a sum
/// into result[1], so that the compiler does not leave out the work.
template <bool with_additions, class T>
HWY_INLINE std::size_t operate(std::size_t count, T* result) {
    const hn::ScalableTag<T> tag;
    const auto factor = hn::Set(tag, result[0]);
    const auto term = hn::Set(tag, result[1]);
    hn::Vec<decltype(tag)> sum[sums];
    for (std::size_t s = 0; s < sums; ++s) sum[s] = hn::Set(tag, T(s));
    for (std::size_t n = 0; n < count; ++n) {
        for (std::size_t s = 0; s < sums; ++s) sum[s] = hn::MulAdd(sum[s], factor, term);
        if constexpr (with_additions) {
            for (std::size_t s = 0; s < sums; ++s) sum[s] = hn::Add(sum[s], term);
        }
    }
    for (std::size_t s = 1; s < sums; ++s) sum[0] = hn::Add(sum[0], sum[s]);
    result[1] = hn::GetLane(sum[0]);
    return count * sums * (with_additions ? 2 : 1) * hn::Lanes(tag);
}

template <class T>
using Operate = std::size_t (*)(std::size_t, T*);

/// Multiply-adds alone, and multiply-adds and additions in turn: some processors have units for additions
/// beside those for multiplications.
std::array<Operate<float>, 2> float32_operations() { return {operate<false, float>, operate<true, float>}; }
std::array<Operate<double>, 2> float64_operations() {
    return {operate<false, double>, operate<true, double>};
}

// Passes over arrays that start on a cache line. `count` is a multiple of the elements of `group` registers.
// A pass that overwrites an array in place has read it, so its lines are in a cache. Stream stores to another
// array bypass the caches, which would otherwise read each line before the store.

/// How many sums read() keeps side by side: two additions per cycle times a latency of four cycles.
constexpr std::size_t group = 8;

HWY_FLATTEN void read(const float* first, const float*, float* written, std::size_t count) {
    const hn::ScalableTag<float> tag;
    hn::Vec<decltype(tag)> sum[group];
    for (auto& one : sum) one = hn::Zero(tag);
    const std::size_t lanes = hn::Lanes(tag);
    for (std::size_t i = 0; i < count; i += group * lanes) {
        for (std::size_t g = 0; g < group; ++g)
            sum[g] = hn::Add(sum[g], hn::Load(tag, first + i + g * lanes));
    }
    for (std::size_t g = 1; g < group; ++g) sum[0] = hn::Add(sum[0], sum[g]);
    *written = hn::GetLane(sum[0]);
}
HWY_FLATTEN void overwrite(const float* first, const float* second, float* written, std::size_t count) {
    const hn::ScalableTag<float> tag;
    for (std::size_t i = 0; i < count; i += hn::Lanes(tag))
        hn::Store(hn::Sub(hn::Load(tag, first + i), hn::Load(tag, second + i)), tag, written + i);
}
HWY_FLATTEN void stream_difference(const float* first, const float* second, float* written,
                                   std::size_t count) {
    const hn::ScalableTag<float> tag;
    for (std::size_t i = 0; i < count; i += hn::Lanes(tag))
        hn::Stream(hn::Sub(hn::Load(tag, first + i), hn::Load(tag, second + i)), tag, written + i);
    hwy::FlushStream();
}
HWY_FLATTEN void negate(const float* first, const float*, float* written, std::size_t count) {
    const hn::ScalableTag<float> tag;
    for (std::size_t i = 0; i < count; i += hn::Lanes(tag))
        hn::Store(hn::Neg(hn::Load(tag, first + i)), tag, written + i);
}
HWY_FLATTEN void stream_copy(const float* first, const float*, float* written, std::size_t count) {
    const hn::ScalableTag<float> tag;
    for (std::size_t i = 0; i < count; i += hn::Lanes(tag))
        hn::Stream(hn::Load(tag, first + i), tag, written + i);
    hwy::FlushStream();
}

std::array<void (*)(const float*, const float*, float*, std::size_t), 5> passes() {
    return {read, overwrite, stream_difference, negate, stream_copy};
}

}  // namespace
}  // namespace voxspring::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace voxspring {
namespace {

HWY_EXPORT(float32_operations);
HWY_EXPORT(float64_operations);
HWY_EXPORT(passes);

/// The number of threads that a parallel region gets. It may be less than omp_get_max_threads(), for example
/// if OMP_THREAD_LIMIT is.
int team_size() {
    int threads = 1;
#pragma omp parallel
#pragma omp single
    threads = omp_get_num_threads();
    return threads;
}

/// Seconds that the slowest thread takes for `work(thread, threads)`, counted from the moment when all
/// threads have started. The time since the fork would be wrong: on a processor shared with other processes a
/// thread may wait longer for a core than it then works.
template <class Work>
double parallel_seconds(Work work, int threads = omp_get_max_threads()) {
    using Clock = std::chrono::steady_clock;
    double slowest = 0;
#pragma omp parallel num_threads(threads) reduction(max : slowest)
    {
#pragma omp barrier
        const auto begin = Clock::now();
        work(std::size_t(omp_get_thread_num()), std::size_t(omp_get_num_threads()));
        slowest = std::chrono::duration<double>(Clock::now() - begin).count();
    }
    return slowest;
}

/// The scalar operations per second of all threads. `operate` is an Operate of the best SIMD target.
template <class T>
double operations_per_second(std::size_t (*operate)(std::size_t, T*)) {
    constexpr std::size_t repetition = 10000;
    std::atomic<std::size_t> operations = 0;  // by all threads in one repetition
    const double seconds = min_seconds([&](int count) {
        operations = 0;
        return parallel_seconds([&](std::size_t, std::size_t) {
            // A factor that the compiler does not know. With this factor the sums converge to a small number.
            volatile T half = T(0.5);
            T result[] = {half, T(1)};
            std::size_t done = 0;
            for (int n = 0; n < count; ++n) {
                result[1] = T(1);
                done = operate(repetition, result);
            }
            operations += done;
            half = result[1];
        });
    });
    return double(operations) / seconds;
}

/// Bytes of the first core's last-level cache, from a file of Linux ("32768K"); 0 if there is no such file.
/// sysconf() is not used: in a virtual machine it may give the caches of the whole host.
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

/// A pass of one thread: it reads `first`, or `first` and `second`, and writes `written`.
using Pass = void (*)(const float* first, const float* second, float* written, std::size_t count);

/// Runs passes on all threads. Each thread has separate memory and was the first to write to it. So the
/// memory lies near the thread's processor, and in its caches.
class Sweeps {
public:
    explicit Sweeps(std::size_t max_footprint) : memory_(std::size_t(team_size())) {
        const std::size_t floats = floats_of(max_footprint);
        for (auto& one : memory_) {
            one = hwy::AllocateAligned<float>(floats);
            if (one == nullptr)
                throw DeviceError("cannot allocate " + std::to_string(floats * sizeof(float)) +
                                  " bytes of memory per thread");
        }
        parallel_seconds(
            [&](std::size_t thread, std::size_t) { std::fill_n(memory_[thread].get(), floats, 1.0F); },
            int(memory_.size()));
    }

    /// Measures the bandwidth at one footprint for three mixes: none, a third, or half of the moved bytes are
    /// written.
    void add(std::size_t footprint, std::vector<Bandwidth>& table) const {
        const auto [read_only, overwrite, stream_difference, negate, stream_copy] =
            HWY_DYNAMIC_DISPATCH(passes)();
        const auto bytes = double(floats_of(footprint) * memory_.size() * sizeof(float));
        // `moves`: how often a byte of the footprint is moved on average. It is moved once, or twice if it is
        // overwritten in place.
        const auto rate = [&](std::size_t arrays, double moves, Pass pass) {
            return moves * bytes / pass_seconds(footprint, arrays, pass);
        };
        table.push_back({bytes, 0, rate(1, 1, read_only)});
        table.push_back({bytes, 1.0 / 3, std::max(rate(2, 1.5, overwrite), rate(3, 1, stream_difference))});
        table.push_back({bytes, 1.0 / 2, std::max(rate(1, 2, negate), rate(2, 1, stream_copy))});
    }

private:
    /// Floats per thread, for one to three arrays one after the other. Each array is a multiple of `group`
    /// registers of the widest target.
    std::size_t floats_of(std::size_t footprint) const {
        constexpr std::size_t whole = std::size_t(6) * 8 * 16;
        return std::max<std::size_t>(footprint / sizeof(float) / memory_.size() / whole, 1) * whole;
    }

    /// Seconds of a pass over `arrays` arrays. It reads the first one or two, and may write the last.
    double pass_seconds(std::size_t footprint, std::size_t arrays, Pass pass) const {
        const std::size_t count = floats_of(footprint) / arrays;
        return min_seconds(
            [&](int repetitions) {
                return parallel_seconds(
                    [&](std::size_t thread, std::size_t) {
                        float* const first = memory_[thread].get();
                        float* const second = first + (arrays > 1 ? count : 0);
                        for (int n = 0; n < repetitions; ++n)
                            pass(first, second, first + (arrays - 1) * count, count);
                    },
                    int(memory_.size()));
            },
            one_of_many(footprint));
    }

    std::vector<hwy::AlignedFreeUniquePtr<float[]>> memory_;  // NOLINT(modernize-avoid-c-arrays)
};

/// Fills in DeviceLimits::bandwidth, the two rates of copies that follow from it, and the cache's size.
void measure_bandwidth(DeviceLimits& limits) {
    const std::size_t cache = last_cache_bytes();
    // If the footprint is four times the cache, each line is evicted before its next use. The upper bound is
    // for virtual machines, which report the whole cache of a host that they share.
    const std::size_t beyond =
        std::clamp<std::size_t>(4 * cache, std::size_t(128) << 20, std::size_t(512) << 20);
    const Sweeps sweeps(beyond);
    // Footprints first fit into the caches of each core, then into the last-level cache, which threads share.
    // They grow in finer steps from a quarter of that cache on.
    auto footprint = (std::size_t(64) << 10) * std::size_t(team_size());
    for (; footprint < beyond; footprint *= footprint < cache / 4 ? 4 : 2)
        sweeps.add(footprint, limits.bandwidth);
    sweeps.add(beyond, limits.bandwidth);
    const auto copy = [&](std::size_t of) {
        return bytes_per_second_of({.bytes = 3, .written_bytes = 1, .footprint_bytes = of}, limits);
    };
    limits.copy_bytes_per_second = copy(beyond);
    if (cache == 0) return;
    limits.cache_bytes = double(cache);
    limits.cached_copy_bytes_per_second = copy(cache / 4);
}

}  // namespace

DeviceLimits CpuBackend::measure_limits() {
    DeviceLimits limits;
    const auto raise = [](double& best, const auto& kinds) {
        for (const auto operate : kinds) best = std::max(best, operations_per_second(operate));
    };
    double float64 = 0;
    const auto measure_operations = [&] {
        raise(limits.float32_operations_per_second, HWY_DYNAMIC_DISPATCH(float32_operations)());
        raise(float64, HWY_DYNAMIC_DISPATCH(float64_operations)());
    };
    // Operations are measured before and after the bandwidth: one measurement is so short that another
    // process may disturb all of it.
    measure_operations();
    measure_bandwidth(limits);
    measure_operations();
    limits.float64_operations_per_second = float64;
    return limits;
}

}  // namespace voxspring
#endif
