#include "cuda/cuda_backend.h"

#include <iomanip>
#include <sstream>

namespace voxspring::cuda {
namespace {

// The longest graph has 2^8 steps: enough that its launch costs nothing beside them, few enough that all
// lengths are captured in milliseconds.
constexpr int graph_lengths = 9;

std::string gibibytes(std::uint64_t bytes) {
    std::ostringstream text;
    text << std::fixed << std::setprecision(2) << double(bytes) / double(1 << 30) << " GiB";
    return text.str();
}

}  // namespace

Capabilities CudaBackend::capabilities() const {
    return {.api = Device::runtime_version(),
            .device = device_.name(),
            .driver = Device::driver_version(),
            .uuid = device_.uuid(),
            .clock = "CUDA event",
            .deterministic = true,
            .highest_mhz = {{"sm", device_.sm_mhz()}, {"memory", device_.memory_mhz()}}};
}

std::string CudaBackend::unsupported(const Problem& problem) const {
    if (std::string why = refused(problem); !why.empty()) return why;
    // What the last upload took is given back, or taken over, by the next.
    const std::uint64_t available = device_.free_bytes() + bytes_held();
    const std::uint64_t needed = bytes_needed(problem);
    if (needed <= available) return {};
    return "needs " + gibibytes(needed) + " of device memory, " + gibibytes(available) + " are free";
}

void CudaBackend::capture() {
    stream_.synchronize();  // what is captured already may still run
    // All lengths now, so that no capture falls into a step that is timed.
    for (int b = 0; b < 2; ++b) {
        auto& graphs = graphs_[std::size_t(b)];
        graphs.clear();
        for (int k = 0; k < graph_lengths; ++k) {
            graphs.push_back(Graph::capture(stream_, [&] {
                for (int n = 0; n < 1 << k; ++n) enqueue_step((b + n) % 2);
            }));
        }
    }
    stream_.synchronize();
}

void CudaBackend::step(int count) {
    for (int k = graph_lengths - 1; k >= 0; --k) {
        for (; count >= 1 << k; count -= 1 << k) {
            graphs_[std::size_t(current_)][std::size_t(k)].launch(stream_);
            if (k == 0) current_ = 1 - current_;
        }
    }
}

}  // namespace voxspring::cuda
