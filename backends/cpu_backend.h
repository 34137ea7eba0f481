// What every backend that runs on the host shares: its clock and how it names the processor.
#pragma once

#include <chrono>
#include <string>

#include "backends/backend.h"

namespace voxspring {

/// A backend whose step() returns when the work is done.
class CpuBackend : public Backend {
public:
    void synchronize() override {}
    /// Of all cores and their SIMD registers, whatever the backend uses of them.
    DeviceLimits measure_limits() override;

private:
    void mark(Mark which) override {
        (which == Mark::begin ? begin_ : end_) = std::chrono::steady_clock::now();
    }
    double seconds_between_marks() const override {
        return std::chrono::duration<double>(end_ - begin_).count();
    }

    std::chrono::steady_clock::time_point begin_, end_;
};

/// `target`: the instruction set in use; `threads`: how many run a step.
Capabilities cpu_capabilities(const std::string& target, int threads);

/// The processor's model name as /proc/cpuinfo gives it, or "unknown CPU".
std::string cpu_name();

}  // namespace voxspring
