#include <cooperative_groups.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <vector>

#include "cuda/device/buffer.h"
#include "cuda/device/event.h"
#include "cuda/device/graph.h"
#include "cuda/device/limits.h"
#include "cuda/kernels/exchange.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

__global__ void do_nothing() {}

/// What passes move. Arrays of `count` words; `written` may be one of those that are read.
struct Sweep {
    const float4* first;
    const float4* second;  ///< of two arrays that are read
    float4* written;
    std::size_t count;
    /// Zero and a sum that there is not, but only the caller knows that: every pass has to read anew.
    std::size_t shift;
    float impossible;
};

__device__ float4 operator-(float4 a, float4 b) {
    return make_float4(a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w);
}

/// Reads one or two arrays and writes one or none, in accesses of 16 bytes past L1, `words` of them a thread
/// at once. All passes in one launch: in the cache a pass takes hardly longer than a launch. A grid of more
/// than one row has a row a pass, one of few blocks goes through the arrays in strides.
template <int reads, bool writes, int words>
__global__ void __launch_bounds__(block) sweep(int passes, Sweep arrays) {
    const std::size_t stride = std::size_t(gridDim.x) * block * words;
    float4 none = make_float4(0, 0, 0, 0);
    for (int n = 0; n < passes; ++n) {
        const std::size_t shift = (blockIdx.y + std::size_t(n)) * arrays.shift;
        for (std::size_t i = std::size_t(blockIdx.x) * block * words + threadIdx.x; i < arrays.count;
             i += stride) {
            float4 word[words];
#pragma unroll
            for (int w = 0; w < words; ++w) word[w] = __ldcg(arrays.first + shift + i + w * block);
            if constexpr (reads == 2) {
                float4 other[words];
#pragma unroll
                for (int w = 0; w < words; ++w) other[w] = __ldcg(arrays.second + shift + i + w * block);
#pragma unroll
                for (int w = 0; w < words; ++w) word[w] = word[w] - other[w];
            }
#pragma unroll
            for (int w = 0; w < words; ++w) {
                if constexpr (writes) {
                    __stcg(arrays.written + i + w * block, word[w]);
                } else {
                    none = none - word[w];
                }
            }
        }
    }
    if (!writes && none.x + none.y + none.z + none.w == arrays.impossible) *arrays.written = none;
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
        publish_if(true, half + blockIdx.x * blockDim.x, point, tag + std::uint32_t(n));
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

/// Passes over parts of one buffer of zeros.
class Sweeps {
public:
    /// A footprint is a multiple of this: one to three arrays of whole blocks of two words a thread.
    static constexpr std::size_t unit = 6 * 2 * block * sizeof(float4);

    Sweeps(std::size_t max_footprint, const Stream& stream, Stopwatch& stopwatch)
        : stream_(stream), stopwatch_(stopwatch) {
        buffer_.resize(max_footprint / sizeof(float4));
        buffer_.fill_with_zeros(stream);
    }

    /// The three shares of writing at one footprint, in place where something is written and not.
    void add(std::size_t footprint, std::vector<Bandwidth>& table) {
        const auto add_best = [&](double written_share, double bytes_per_second) {
            table.push_back({double(footprint), written_share, bytes_per_second});
        };
        add_best(0, of_arrays<1, false>(footprint, 1));
        add_best(1.0 / 3, std::max(of_arrays<2, true>(footprint, 2), of_arrays<2, true>(footprint, 3)));
        add_best(1.0 / 2, std::max(of_arrays<1, true>(footprint, 1), of_arrays<1, true>(footprint, 2)));
    }

private:
    /// The last of the arrays is the one that is written.
    template <int reads, bool writes>
    double of_arrays(std::size_t footprint, std::size_t arrays) {
        const std::size_t count = footprint / sizeof(float4) / arrays;
        float4* const first = buffer_.data();
        const Sweep moved{.first = first,
                          .second = first + (reads - 1) * count,
                          .written = first + (arrays - 1) * count,
                          .count = count,
                          .shift = 0,
                          .impossible = -1};
        const double seconds = std::min(of_words<reads, writes, 1>(moved), of_words<reads, writes, 2>(moved));
        return double((reads + (writes ? 1 : 0)) * count * sizeof(float4)) / seconds;
    }

    /// Seconds of a pass: of blocks that stay, or of new ones for every few words.
    template <int reads, bool writes, int words>
    double of_words(const Sweep& moved) {
        const auto kernel = sweep<reads, writes, words>;
        const Patience patience = one_of_many(moved.count * sizeof(float4));
        const unsigned resident = blocks_at_once(kernel);
        const double staying = min_seconds(
            [&](int count) {
                return stopwatch_.seconds([&] {
                    kernel<<<resident, block, 0, stream_.get()>>>(count, moved);
                    check(cudaGetLastError());
                });
            },
            patience);
        constexpr int max_rows = 65535;
        const auto columns = unsigned(moved.count / (block * words));
        const double fresh = min_seconds(
            [&](int count) {
                return stopwatch_.seconds([&] {
                    for (int left = count; left > 0; left -= max_rows) {
                        kernel<<<dim3(columns, unsigned(std::min(left, max_rows))), block, 0,
                                 stream_.get()>>>(1, moved);
                        check(cudaGetLastError());
                    }
                });
            },
            patience);
        return std::min(staying, fresh);
    }

    const Stream& stream_;
    Stopwatch& stopwatch_;
    Buffer<float4> buffer_;
};

/// Fills in the table and the two rates of copies that are taken from it.
void measure_bandwidth(DeviceLimits& limits, const Stream& stream, Stopwatch& stopwatch) {
    const auto cache = std::size_t(attribute(cudaDevAttrL2CacheSize));
    const auto whole = [](std::size_t bytes) {
        return std::max<std::size_t>(bytes / Sweeps::unit, 1) * Sweeps::unit;
    };
    // Eight times the cache leaves no line in it until its next use.
    const std::size_t beyond = whole(std::max(8 * cache, std::size_t(128) << 20));
    const std::size_t within = whole(cache / 4);
    std::vector<std::size_t> footprints;
    if (cache != 0) {
        // Of a cache in two halves, each of which keeps a copy of what its own processors read, half may be
        // all there is; a few arrays that just do not fit are still found there in part.
        footprints = {whole(cache / 32),    whole(cache / 8),     within,
                      whole(cache / 2),     whole(cache / 4 * 3), whole(cache),
                      whole(cache / 2 * 3), whole(3 * cache)};
    }
    footprints.push_back(beyond);
    Sweeps sweeps(beyond, stream, stopwatch);
    for (const std::size_t footprint : footprints) sweeps.add(footprint, limits.bandwidth);
    const auto copy = [&](std::size_t of) {
        return bytes_per_second_of({.bytes = 3, .written_bytes = 1, .footprint_bytes = of}, limits);
    };
    limits.copy_bytes_per_second = copy(beyond);
    if (cache == 0) return;
    limits.cache_bytes = double(cache);
    limits.cached_copy_bytes_per_second = copy(within);
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
    measure_bandwidth(limits, stream, stopwatch);
    limits.launch_seconds = launch_seconds(stream, stopwatch);
    limits.grid_barrier_seconds = grid_barrier_seconds(stream, stopwatch);
    limits.exchange_seconds = exchange_seconds(stream, stopwatch);
    limits.float32_operations_per_second = operations_per_second<float>(stream, stopwatch);
    limits.float64_operations_per_second = operations_per_second<double>(stream, stopwatch);
    return limits;
}

}  // namespace voxspring::cuda
