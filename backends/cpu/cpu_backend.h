// What every backend that runs on the host shares: its clock, its divergence monitor and how it names the
// processor.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
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

/// One with a divergence monitor, which checks after exactly as many steps as it was told.
class MonitoredCpuBackend : public CpuBackend {
public:
    void upload(const Problem& problem, const State& state) final;
    void step(int count) final;
    void monitor(const DivergenceMonitor& monitor) final { next_monitor_ = monitor; }
    std::optional<Divergence> divergence() final { return divergence_; }

private:
    /// upload() without the monitor.
    virtual void begin(const Problem& problem, const State& state) = 0;
    /// step() without the monitor.
    virtual void integrate(int count) = 0;
    /// Whether every particle is finite and its latest step no longer than that.
    virtual bool within(double largest_increment) = 0;

    DivergenceMonitor monitor_, next_monitor_;
    std::int64_t steps_ = 0;      ///< since upload()
    std::int64_t last_good_ = 0;  ///< the latest of them that a check found within bounds
    std::optional<Divergence> divergence_;
};

/// `target`: the instruction set in use; `threads`: how many run a step.
Capabilities cpu_capabilities(const std::string& target, int threads);

/// The processor's model name as /proc/cpuinfo gives it, or "unknown CPU".
std::string cpu_name();

}  // namespace voxspring
