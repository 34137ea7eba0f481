#include "cuda/common/cuda_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <span>

#include "cuda/common/device_borders.h"
#include "cuda/device/compiler.h"

namespace voxspring::cuda {
namespace {

std::string gibibytes(std::uint64_t bytes) {
    return fmt::format("{:.2f} GiB", double(bytes) / double(1 << 30));
}

void copy(void* to, const void* from, std::size_t bytes, const Stream& stream) {
    if (bytes != 0) check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, stream.get()));
}

}  // namespace

Capabilities CudaBackend::capabilities() const {
    return {.api = Device::runtime_version(),
            .device = device_.name,
            .driver = Device::driver_version(),
            .uuid = device_.uuid,
            .clock = "CUDA event",
            .deterministic = true,
            .highest_mhz = {{"sm", device_.sm_mhz}, {"memory", device_.memory_mhz}},
            .kernel_compiler = compiler_and_options(device_.architecture),
            .family = "cuda",
            .limits_of = "CUDA",
            .has_borders = gives_borders(),
            .border_ways = gives_borders() ? border_ways(splits_steps()) : std::vector<std::string>(),
            .devices = device_.count};
}

std::string CudaBackend::unsupported(const Problem& problem) const {
    if (std::string why = Backend::unsupported(problem); !why.empty()) return why;
    if (std::string why = refused(problem); !why.empty()) return why;
    // Memory that this backend holds counts as available: the next upload frees it or uses it again.
    std::uint64_t available = device_.free_bytes() + bytes_held();
    for (const Buffer<std::byte>& copy : start_) available += copy.bytes();
    if (max_bytes_needed(problem) <= available) return {};
    const std::uint64_t needed = bytes_needed(problem);
    if (needed <= available) return {};
    return "needs " + gibibytes(needed) + " of device memory, but only " + gibibytes(available) + " are free";
}

void CudaBackend::synchronize() {
    let_end();
    wait_for_stream();
}

void CudaBackend::wait_for_stream() {
    stream_.synchronize();
    check_waits();
}

void CudaBackend::check_waits() const {
    if (const std::string note = failure_note(); !note.empty()) throw DeviceError(note);
    if (border_stall_.size() == 0) return;
    const std::uint64_t mark = *static_cast<const volatile std::uint64_t*>(border_stall_.data());
    if (mark != 0)
        throw DeviceError(
            fmt::format("waited {} seconds in vain for message {} from another part of the body",
                        max_wait_nanoseconds / 1'000'000'000, ResidentStall::unpacked(mark).step));
}

WaitLimit CudaBackend::border_wait() {
    border_stall_.resize(1);
    *border_stall_.data() = 0;
    return {border_stall_.data(), max_wait_nanoseconds};
}

void CudaBackend::forget_graphs() {
    stream_.synchronize();  // a captured graph may still run
    graphs_ = {};
    exchanging_graphs_ = {};
}

void CudaBackend::begin_upload() {
    try {
        synchronize();
    } catch (const DeviceError&) {
        // A launch that waited in vain has spoilt only the state, which this upload replaces.
        stream_.synchronize();
    }
    start_.clear();
    compile_time_ = {};
    is_split_ = false;
    if (border_stall_.size() > 0) *border_stall_.data() = 0;
}

BordersFirst* CudaBackend::enable_border_stream(const std::vector<SharedParticles>& borders,
                                                const std::string& way) {
    is_split_ = false;
    exchanging_graphs_ = {};
    if (!overlaps(way)) return nullptr;
    std::vector<std::uint32_t> particles;
    for (const SharedParticles& shared : borders) {
        particles.insert(particles.end(), shared.sent.begin(), shared.sent.end());
        particles.insert(particles.end(), shared.received.begin(), shared.received.end());
    }
    if (!split_steps(particles))
        throw Unavailable(
            "peer_overlap, stores_overlap and nccl_overlap need particles to step while borders are "
            "exchanged, but every block of this part has particles of a border");
    if (!borders_first_) borders_first_.emplace(stream_);
    borders_first_->order_after_main_stream();
    is_split_ = true;
    return &*borders_first_;
}

bool CudaBackend::keep_start() {
    let_end();
    const std::vector<StateArray> arrays = state_arrays();
    std::uint64_t needed = 0;
    for (const StateArray& array : arrays) needed += array.bytes;
    start_.clear();
    // At least half of the free memory is left to later allocations. Parts of a body that share the device
    // may ask at the same time.
    if (needed > device_.free_bytes() / 2 / std::size_t(device_.parts)) return false;
    for (const StateArray& array : arrays) {
        start_.emplace_back().resize(array.bytes);
        copy(start_.back().data(), array.data, array.bytes, stream_);
    }
    return true;
}

void CudaBackend::rewind() {
    let_end();
    const std::vector<StateArray> arrays = state_arrays();
    for (std::size_t n = 0; n < arrays.size(); ++n)
        copy(arrays[n].data, start_[n].data(), arrays[n].bytes, stream_);
    reset_to_step_zero();
    rewound();
}

void CudaBackend::reset_to_step_zero() {
    current_ = 0;
    monitor_ = next_monitor_;
    steps_ = last_check_ = 0;
    if (borders_first_) borders_first_->order_after_main_stream();
    rest_tool();
    const FirstDivergence none{std::numeric_limits<long long>::max(), std::numeric_limits<long long>::max()};
    if (monitor_.every > 0) first_divergence_.upload(std::span(&none, 1), stream_);
}

template <class Enqueue>
void CudaBackend::between_checks(int count, Enqueue enqueue) {
    // If graphs replay the steps, checks that are due every 32 steps or more are made only at the end of a
    // graph. After a graph of 256 steps, the longest, a check costs less than 1% of the graph's time, even if
    // a step takes no longer than a launch.
    const bool often = monitor_.every > 0 && monitor_.every < 32;
    while (count > 0) {
        const int steps = often ? std::min(count, monitor_.every - int(steps_ - last_check_)) : count;
        enqueue(steps);
        count -= steps;
    }
}

void CudaBackend::step(int count) {
    between_checks(count, [this](int steps) { enqueue_steps(steps); });
}

template <class GraphOf>
void CudaBackend::launch_graphs(int count, GraphOf graph) {
    for (int k = graph_lengths - 1; k >= 0; --k) {
        for (; count >= 1 << k; count -= 1 << k) {
            graph(k).launch(stream_);
            if (k == 0) current_ = 1 - current_;
            stepped(1 << k);
        }
    }
}

void CudaBackend::enqueue_steps(int count) {
    if (is_split_ && splits_next_step()) {
        // Here split steps are not captured in a graph: another stream could wait only for the end of the
        // whole graph, but the host has to send a border before that.
        for (; count > 0; --count) {
            enqueue_split_step();
            stepped(1);
        }
        return;
    }
    if (borders_first_) borders_first_->order_after_main_stream();
    if (!replays_steps()) {
        for (; count > 0; --count) {
            launch_step(current_);
            current_ = 1 - current_;
            stepped(1);
        }
        return;
    }
    launch_graphs(count, [this](int k) -> Graph& {
        std::optional<Graph>& graph =
            graphs_[std::size_t(kind_of_step())][std::size_t(current_)][std::size_t(k)];
        if (!graph) {
            graph.emplace(Graph::capture(stream_, [&] {
                for (int n = 0; n < 1 << k; ++n) launch_step((current_ + n) % 2);
            }));
        }
        return *graph;
    });
}

void CudaBackend::enqueue_split_step() {
    enqueue_tool(current_);
    borders_first_->step(
        [this](const Stream& stream) { enqueue_part(current_, StepPart::border, stream); },
        [this](const Stream& stream) { enqueue_part(current_, StepPart::interior, stream); });
    current_ = 1 - current_;
}

Graph& CudaBackend::exchanging_graph(DeviceBorders& borders, int k) {
    std::optional<Graph>& graph = exchanging_graphs_[std::size_t(current_)][std::size_t(k)];
    if (graph) return *graph;
    const int reading = current_;
    graph.emplace(Graph::capture(stream_, [&] {
        for (int n = 0; n < 1 << k; ++n) {
            if (is_split_) {
                enqueue_split_step();
                borders_first_->step_follows(n + 1 < 1 << k);
            } else {
                launch_step(current_);
                current_ = 1 - current_;
            }
            borders.send();
            borders.receive();
        }
    }));
    current_ = reading;
    return *graph;
}

bool CudaBackend::prepare_exchanges(DeviceBorders& borders, int count) {
    if (!borders.waits_on_device() || !replays_steps() || !make_steps_alike()) return false;
    // Checks may cut the steps anywhere, so graphs of every length up to `count` may be needed.
    const int first = current_;
    for (current_ = 0; current_ < 2; ++current_) {
        for (int k = 0; k < graph_lengths && 1 << k <= count; ++k) exchanging_graph(borders, k);
    }
    current_ = first;
    // Capturing enqueued no work, so the next step that is not in a graph has to order the two streams
    // itself.
    if (borders_first_) borders_first_->order_after_main_stream();
    return true;
}

void CudaBackend::step_and_exchange(DeviceBorders& borders, int count) {
    between_checks(count, [&](int steps) {
        launch_graphs(steps, [&](int k) -> Graph& { return exchanging_graph(borders, k); });
    });
}

void CudaBackend::stepped(int count) {
    steps_ += count;
    if (monitor_.every > 0 && steps_ - last_check_ >= monitor_.every) check_divergence();
}

void CudaBackend::check_divergence() {
    let_end();
    // The check reads ghosts as well, so none may arrive meanwhile.
    if (borders_first_) borders_first_->order_after_main_stream();
    enqueue_divergence_check({steps_, last_check_, monitor_.largest_increment}, first_divergence_.data());
    last_check_ = steps_;
}

std::optional<Divergence> CudaBackend::divergence() {
    if (monitor_.every == 0) return std::nullopt;
    synchronize();
    FirstDivergence first{};
    first_divergence_.download(std::span(&first, 1), stream_);
    if (first.found == std::numeric_limits<long long>::max()) return std::nullopt;
    return Divergence{first.last_good, first.found};
}

}  // namespace voxspring::cuda
