#include "backends/backend.h"

#include <chrono>

namespace voxspring {

std::string to_string(Precision precision) { return precision == Precision::float32 ? "float32" : "float64"; }

std::string Backend::unsupported(const Problem& problem) const {
    // tool() only says whether there is a facet, but a facet that was asked for may change the backend.
    const bool has_tool = const_cast<Backend*>(this)->tool() != nullptr;
    return problem.has_tool() && !has_tool ? "the backend has no tool" : std::string();
}

Timing Backend::timed(const std::function<void()>& run) {
    synchronize();
    const auto begin = std::chrono::steady_clock::now();
    mark(Mark::begin);
    run();
    mark(Mark::end);
    synchronize();
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin;
    return {.device_seconds = seconds_between_marks(), .host_seconds = elapsed.count()};
}

}  // namespace voxspring
