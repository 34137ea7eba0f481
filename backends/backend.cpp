#include "backends/backend.h"

#include <chrono>

namespace voxspring {

std::string to_string(Precision precision) { return precision == Precision::float32 ? "float32" : "float64"; }

namespace {

constexpr const char* no_tool = "the backend has no tool";

}  // namespace

std::string Backend::unsupported(const Problem& problem) const {
    return problem.has_tool() && !has_tool() ? no_tool : std::string();
}

void Backend::move_tool(const glm::dvec3&) { throw DeviceError(no_tool); }
glm::dvec3 Backend::tool_force() { throw DeviceError(no_tool); }

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
