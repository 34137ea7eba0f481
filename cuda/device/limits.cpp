#include "cuda/device/limits.h"

#include <cuda_runtime_api.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/layout/records/resident.h"
#include "cuda/device/buffer.h"
#include "cuda/device/kernel.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/limits.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 256;

/// The kernels of limits.cu, each loaded when it is first asked for.
class LimitKernels {
public:
    explicit LimitKernels(const Device& device) : device_(device) {}
    const Device& device() const { return device_; }
    /// Drops the time that compiling took, since it belongs to no backend.
    std::shared_ptr<const Kernel> get(const std::string& name) const {
        CompileTime time;
        return Kernel::get({"limits.cu", {{"THREADS", std::to_string(block)}}}, device_, time, name);
    }

private:
    const Device& device_;
};

class Stopwatch {
public:
    explicit Stopwatch(const Stream& stream) : stream_(stream) {}
    /// The seconds between two events in the stream, before and after the work that `enqueue()` puts into it.
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

double launch_seconds(const LimitKernels& kernels, const Stream& stream, Stopwatch& stopwatch) {
    constexpr int launches = 512;
    const auto kernel = kernels.get("do_nothing");
    const Graph graph = Graph::capture(stream, [&] {
        for (int n = 0; n < launches; ++n) kernel->launch(stream, dim3(1), dim3(32), 0);
    });
    const double graph_seconds = min_seconds([&](int count) {
        return stopwatch.seconds([&] {
            for (int n = 0; n < count; ++n) graph.launch(stream);
        });
    });
    return graph_seconds / launches;
}

/// Measures bandwidths by passes over parts of one buffer of zeros.
class Sweeps {
public:
    /// Every footprint, the bytes of all arrays of a pass, is a multiple of this number. So whole blocks
    /// cover each of one, two or three arrays, even if a thread has two words.
    static constexpr std::size_t unit = std::size_t(6) * 2 * block * sizeof(float4);

    Sweeps(std::size_t max_footprint, const LimitKernels& kernels, const Stream& stream, Stopwatch& stopwatch)
        : kernels_(kernels), stream_(stream), stopwatch_(stopwatch) {
        buffer_.resize(max_footprint / sizeof(float4));
        buffer_.fill_with_zeros(stream);
    }

    /// Measures the bandwidth at one footprint for three mixes: none, a third and half of the bytes moved are
    /// written. Passes that write are tried both in place and with a separate array to write.
    void add(std::size_t footprint, std::vector<Bandwidth>& table) {
        const auto add_best = [&](double written_share, double bytes_per_second) {
            table.push_back({double(footprint), written_share, bytes_per_second});
        };
        add_best(0, of_arrays<1, false>(footprint, 1));
        add_best(1.0 / 3, std::max(of_arrays<2, true>(footprint, 2), of_arrays<2, true>(footprint, 3)));
        add_best(1.0 / 2, std::max(of_arrays<1, true>(footprint, 1), of_arrays<1, true>(footprint, 2)));
    }

private:
    /// Bytes per second of a pass over `arrays` arrays of `footprint` bytes together. The pass reads the
    /// first `reads` of the arrays and, if `writes`, writes the last one, which may be one that it reads.
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

    /// Seconds per pass, by the faster of two kinds of launch: few blocks that stride through the arrays, or
    /// one block for every `block` x `words` words.
    template <int reads, bool writes, int words>
    double of_words(const Sweep& moved) {
        const auto kernel = kernels_.get(fmt::format("sweep_{}_{}_{}", reads, writes ? 1 : 0, words));
        const Patience patience = one_of_many(moved.count * sizeof(float4));
        const unsigned resident = kernel->blocks_at_once(kernels_.device(), block);
        const double staying = min_seconds(
            [&](int count) {
                return stopwatch_.seconds(
                    [&] { kernel->launch(stream_, dim3(resident), dim3(block), 0, count, moved); });
            },
            patience);
        constexpr int max_rows = 65535;
        const auto columns = unsigned(moved.count / (std::size_t(block) * words));
        const double fresh = min_seconds(
            [&](int count) {
                return stopwatch_.seconds([&] {
                    for (int left = count; left > 0; left -= max_rows) {
                        const dim3 grid(columns, unsigned(std::min(left, max_rows)));
                        constexpr int passes = 1;
                        kernel->launch(stream_, grid, dim3(block), 0, passes, moved);
                    }
                });
            },
            patience);
        return std::min(staying, fresh);
    }

    const LimitKernels& kernels_;
    const Stream& stream_;
    Stopwatch& stopwatch_;
    Buffer<float4> buffer_;
};

/// Fills in the table of bandwidths, and the rates of copying that follow from the table.
void measure_bandwidth(DeviceLimits& limits, const LimitKernels& kernels, const Stream& stream,
                       Stopwatch& stopwatch) {
    const auto cache = std::size_t(kernels.device().cache_bytes);
    const auto whole = [](std::size_t bytes) {
        return std::max<std::size_t>(bytes / Sweeps::unit, 1) * Sweeps::unit;
    };
    // At eight times the size of the cache, no line stays in the cache until its next use.
    const std::size_t beyond = whole(std::max(8 * cache, std::size_t(128) << 20));
    const std::size_t within = whole(cache / 4);
    std::vector<std::size_t> footprints;
    if (cache != 0) {
        // Some caches have two halves, each of which keeps a copy of what its processors read. Then only half
        // of the size may be usable. Arrays that are slightly too large still stay in the cache in part.
        footprints = {whole(cache / 32),    whole(cache / 8),     within,
                      whole(cache / 2),     whole(cache / 4 * 3), whole(cache),
                      whole(cache / 2 * 3), whole(3 * cache)};
    }
    footprints.push_back(beyond);
    Sweeps sweeps(beyond, kernels, stream, stopwatch);
    for (const std::size_t footprint : footprints) sweeps.add(footprint, limits.bandwidth);
    const auto copy = [&](std::size_t of) {
        return bytes_per_second_of({.bytes = 3, .written_bytes = 1, .footprint_bytes = of}, limits);
    };
    limits.copy_bytes_per_second = copy(beyond);
    if (cache == 0) return;
    limits.cache_bytes = double(cache);
    limits.cached_copy_bytes_per_second = copy(within);
}

std::optional<double> grid_barrier_seconds(const LimitKernels& kernels, const Stream& stream,
                                           Stopwatch& stopwatch) {
    if (!kernels.device().launches_together) return std::nullopt;
    const auto kernel = kernels.get("meet");
    const auto blocks = unsigned(kernels.device().multiprocessors);
    Buffer<std::uint32_t> arrived;
    arrived.resize(1);
    arrived.fill_with_zeros(stream);
    std::uint32_t before = 0;
    return min_seconds([&](int count) {
        const double seconds = stopwatch.seconds([&] {
            kernel->launch_together(stream, dim3(blocks), dim3(block), 0, count, arrived.data(), before);
        });
        before += std::uint32_t(count) * blocks;
        return seconds;
    });
}

std::optional<double> exchange_seconds(const LimitKernels& kernels, const Stream& stream,
                                       Stopwatch& stopwatch) {
    if (!kernels.device().launches_together) return std::nullopt;
    const auto kernel = kernels.get("exchange");
    const auto blocks = unsigned(kernels.device().multiprocessors);
    Buffer<layout::TaggedPoint> points;
    points.resize(std::size_t(2) * blocks * block);
    points.fill_with_zeros(stream);
    std::uint32_t tag = 0;
    return min_seconds([&](int count) {
        const double seconds = stopwatch.seconds([&] {
            kernel->launch_together(stream, dim3(blocks), dim3(block), 0, points.data(), count, tag);
        });
        tag += std::uint32_t(count);
        return seconds;
    });
}

template <class Real>
double operations_per_second(const LimitKernels& kernels, const char* name, const Stream& stream,
                             Stopwatch& stopwatch) {
    Buffer<Real> result;
    result.resize(1);
    const auto kernel = kernels.get(name);
    const unsigned blocks = kernel->blocks_at_once(kernels.device(), block);
    constexpr Real factor = 0.5, impossible = -1;
    const double seconds = min_seconds([&](int count) {
        return stopwatch.seconds([&] {
            kernel->launch(stream, dim3(blocks), dim3(block), 0, count, factor, impossible, result.data());
        });
    });
    return double(blocks) * block * limit_sums * limit_multiply_adds / seconds;
}

}  // namespace

DeviceLimits measure_limits(const Device& device, const Stream& stream) {
    const LimitKernels kernels(device);
    Stopwatch stopwatch(stream);
    DeviceLimits limits;
    measure_bandwidth(limits, kernels, stream, stopwatch);
    limits.launch_seconds = launch_seconds(kernels, stream, stopwatch);
    limits.grid_barrier_seconds = grid_barrier_seconds(kernels, stream, stopwatch);
    limits.exchange_seconds = exchange_seconds(kernels, stream, stopwatch);
    limits.float32_operations_per_second =
        operations_per_second<float>(kernels, "multiply_add_float32", stream, stopwatch);
    limits.float64_operations_per_second =
        operations_per_second<double>(kernels, "multiply_add_float64", stream, stopwatch);
    return limits;
}

}  // namespace voxspring::cuda
