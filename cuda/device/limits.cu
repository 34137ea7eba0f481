#include <cooperative_groups.h>

#include <algorithm>
#include <cstddef>
#include <optional>

#include "cuda/device/buffer.h"
#include "cuda/device/event.h"
#include "cuda/device/graph.h"
#include "cuda/device/limits.h"
#include "cuda/kernels/exchange.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

__global__ void do_nothing() {}

/// Reads two arrays and overwrites one, in accesses of 16 bytes past L1. All passes in one launch: in the
/// cache a pass takes hardly longer than a launch.
__global__ void __launch_bounds__(block)
    overwrite(int passes, const float4* current, float4* previous, std::size_t count) {
    const std::size_t threads = std::size_t(gridDim.x) * blockDim.x;
    for (int n = 0; n < passes; ++n) {
        for (std::size_t i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x; i < count; i += threads) {
            const float4 a = __ldcg(current + i);
            const float4 b = __ldcg(previous + i);
            __stcg(previous + i, make_float4(a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w));
        }
    }
}

__global__ void __launch_bounds__(block) meet(int barriers) {
    const cooperative_groups::grid_group grid = cooperative_groups::this_grid();
    for (int n = 0; n < barriers; ++n) grid.sync();
}

/// The threads of a block stand in rings with those of all others: each sends a point on and waits for those
/// of both its neighbours, with tags from `tag` + 1 on.
__global__ void __launch_bounds__(block) exchange(TaggedPoint* points, int exchanges, std::uint32_t tag) {
    const unsigned before = (blockIdx.x + gridDim.x - 1) % gridDim.x, after = (blockIdx.x + 1) % gridDim.x;
    Vector<float> point{0, 0, 0};
    for (int n = 1; n <= exchanges; ++n) {
        TaggedPoint* const half = points + (n % 2) * gridDim.x * blockDim.x + threadIdx.x;
        publish(half + blockIdx.x * blockDim.x, point, tag + std::uint32_t(n));
        TaggedPoint left{}, right{};
        do {
            left = look_up(half + before * blockDim.x);
            right = look_up(half + after * blockDim.x);
        } while (left.tag != tag + std::uint32_t(n) || right.tag != tag + std::uint32_t(n));
        // So that no exchange can begin before the last one is over.
        point = left.point + right.point;
    }
}

/// Independent sums of a thread: with 8 warps or more a scheduler, each has a multiply-add ready in every
/// cycle.
constexpr int sums = 8;
constexpr int multiply_adds = 2048;  // of each sum and repetition

/// Writes nothing, but only the caller knows that: the sums converge to 2.
template <class Real>
__global__ void __launch_bounds__(block)
    multiply_add(int repetitions, Real factor, Real impossible, Real* result) {
    Real sum[sums];
    for (int s = 0; s < sums; ++s) sum[s] = Real(threadIdx.x + s);
    for (int n = 0; n < repetitions; ++n) {
#pragma unroll 16
        for (int m = 0; m < multiply_adds; ++m) {
#pragma unroll
            for (int s = 0; s < sums; ++s) sum[s] = sum[s] * factor + Real(1);
        }
    }
    Real total = 0;
    for (int s = 0; s < sums; ++s) total += sum[s];
    if (total == impossible) *result = total;
}

int attribute(cudaDeviceAttr which) {
    int device = 0;
    int value = 0;
    check(cudaGetDevice(&device));
    check(cudaDeviceGetAttribute(&value, which, device));
    return value;
}

/// Blocks of `kernel` that all SMs hold at once.
template <class Kernel>
unsigned blocks_at_once(Kernel kernel) {
    int blocks_per_sm = 0;
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks_per_sm, kernel, int(block), 0));
    if (blocks_per_sm < 1) throw DeviceError("an SM has no room for a block that measures it");
    return unsigned(blocks_per_sm * attribute(cudaDevAttrMultiProcessorCount));
}

class Stopwatch {
public:
    explicit Stopwatch(const Stream& stream) : stream_(stream) {}
    /// What `enqueue()` puts into the stream takes, between two events.
    template <class Enqueue>
    double seconds(Enqueue enqueue) {
        begin_.record(stream_);
        enqueue();
        end_.record(stream_);
        stream_.synchronize();
        return end_.seconds_since(begin_);
    }

private:
    const Stream& stream_;
    Event begin_, end_;
};

double launch_seconds(const Stream& stream, Stopwatch& stopwatch) {
    constexpr int kernels = 512;
    // Loads its code, which must not happen first in a capture.
    static_cast<void>(blocks_at_once(do_nothing));
    const Graph graph = Graph::capture(stream, [&] {
        for (int n = 0; n < kernels; ++n) {
            do_nothing<<<1, 32, 0, stream.get()>>>();
            check(cudaGetLastError());
        }
    });
    const double graph_seconds = min_seconds([&](int count) {
        return stopwatch.seconds([&] {
            for (int n = 0; n < count; ++n) graph.launch(stream);
        });
    });
    return graph_seconds / kernels;
}

/// Of two arrays of `bytes` each.
double bytes_per_second(std::size_t bytes, const Stream& stream, Stopwatch& stopwatch) {
    Buffer<float4> current;
    Buffer<float4> previous;
    current.resize(bytes / sizeof(float4));
    previous.resize(current.size());
    current.fill_with_zeros(stream);
    previous.fill_with_zeros(stream);
    const unsigned blocks = blocks_at_once(overwrite);
    const double seconds = min_seconds([&](int count) {
        return stopwatch.seconds([&] {
            overwrite<<<blocks, block, 0, stream.get()>>>(count, current.data(), previous.data(),
                                                          current.size());
            check(cudaGetLastError());
        });
    });
    return 3 * double(current.bytes()) / seconds;
}

std::optional<double> grid_barrier_seconds(const Stream& stream, Stopwatch& stopwatch) {
    if (attribute(cudaDevAttrCooperativeLaunch) == 0) return std::nullopt;
    static_cast<void>(blocks_at_once(meet));
    const auto blocks = unsigned(attribute(cudaDevAttrMultiProcessorCount));
    return min_seconds([&](int count) {
        return stopwatch.seconds([&] {
            void* arguments[] = {&count};
            check(cudaLaunchCooperativeKernel(reinterpret_cast<const void*>(&meet), dim3(blocks), dim3(block),
                                              arguments, 0, stream.get()));
        });
    });
}

std::optional<double> exchange_seconds(const Stream& stream, Stopwatch& stopwatch) {
    if (attribute(cudaDevAttrCooperativeLaunch) == 0) return std::nullopt;
    static_cast<void>(blocks_at_once(exchange));
    const auto blocks = unsigned(attribute(cudaDevAttrMultiProcessorCount));
    Buffer<TaggedPoint> points;
    points.resize(std::size_t(2) * blocks * block);
    points.fill_with_zeros(stream);
    TaggedPoint* first = points.data();
    std::uint32_t tag = 0;
    return min_seconds([&](int count) {
        const double seconds = stopwatch.seconds([&] {
            void* arguments[] = {&first, &count, &tag};
            check(cudaLaunchCooperativeKernel(reinterpret_cast<const void*>(&exchange), dim3(blocks),
                                              dim3(block), arguments, 0, stream.get()));
        });
        tag += std::uint32_t(count);
        return seconds;
    });
}

template <class Real>
double operations_per_second(const Stream& stream, Stopwatch& stopwatch) {
    Buffer<Real> result;
    result.resize(1);
    const unsigned blocks = blocks_at_once(multiply_add<Real>);
    const double seconds = min_seconds([&](int count) {
        return stopwatch.seconds([&] {
            multiply_add<Real><<<blocks, block, 0, stream.get()>>>(count, Real(0.5), Real(-1), result.data());
            check(cudaGetLastError());
        });
    });
    return double(blocks) * block * sums * multiply_adds / seconds;
}

}  // namespace

DeviceLimits measure_limits(const Stream& stream) {
    Stopwatch stopwatch(stream);
    DeviceLimits limits;
    const auto cache = std::size_t(attribute(cudaDevAttrL2CacheSize));
    // Twice four times the cache leaves no line in it until its next use.
    limits.copy_bytes_per_second =
        bytes_per_second(std::max(4 * cache, std::size_t(64) << 20), stream, stopwatch);
    if (cache != 0) {
        limits.cache_bytes = double(cache);
        limits.cached_copy_bytes_per_second = bytes_per_second(cache / 8, stream, stopwatch);
    }
    limits.launch_seconds = launch_seconds(stream, stopwatch);
    limits.grid_barrier_seconds = grid_barrier_seconds(stream, stopwatch);
    limits.exchange_seconds = exchange_seconds(stream, stopwatch);
    limits.float32_operations_per_second = operations_per_second<float>(stream, stopwatch);
    limits.float64_operations_per_second = operations_per_second<double>(stream, stopwatch);
    return limits;
}

}  // namespace voxspring::cuda
