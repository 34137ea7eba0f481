// Code that backends on the host's processor share: the clock, the divergence monitor, borders and the
// processor's name.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/backend.h"

namespace voxspring {

/// A backend whose step() returns when the work is done.
class CpuBackend : public Backend, public LimitsFacet {
public:
    void synchronize() override {}
    LimitsFacet* limits() override { return this; }
    /// Measures all cores and their SIMD registers, even if the backend uses only some of them.
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

/// A backend with a divergence monitor, which checks exactly when a check is due (DivergenceMonitor::every).
class MonitoredCpuBackend : public CpuBackend {
public:
    void upload(const Problem& problem, const State& state) final;
    void step(int count) final;
    void monitor(const DivergenceMonitor& monitor) final { next_monitor_ = monitor; }
    std::optional<Divergence> divergence() final { return divergence_; }

private:
    /// Does the work of upload() without the monitor.
    virtual void begin(const Problem& problem, const State& state) = 0;
    /// Does the work of step() without the monitor.
    virtual void integrate(int count) = 0;
    /// Whether every particle is finite and moved by at most `largest_increment` in its latest step.
    virtual bool within(double largest_increment) = 0;

    DivergenceMonitor monitor_, next_monitor_;
    std::int64_t steps_ = 0;      ///< since upload()
    std::int64_t last_good_ = 0;  ///< the latest step that a check found within bounds
    std::optional<Divergence> divergence_;
};

/// A border of a backend that keeps vectors of type `Vec` in canonical order.
template <class Vec>
class VectorBorder final : public Border {
public:
    /// `arrays()` returns the array of positions or displacements after the latest step, and the array of
    /// their low parts if the backend keeps one.
    VectorBorder(std::function<std::vector<std::vector<Vec>*>()> arrays, std::vector<std::uint32_t> particles)
        : arrays_(std::move(arrays)), particles_(std::move(particles)) {}

    std::size_t bytes() const override { return particles_.size() * arrays_().size() * sizeof(Vec); }
    void read(std::byte* to) const override {
        each_place([&](const Vec& here) { to = std::copy_n(bytes_of(here), sizeof(Vec), to); });
    }
    void write(const std::byte* from) override {
        each_place([&](Vec& here) {
            std::memcpy(&here, from, sizeof(Vec));
            from += sizeof(Vec);
        });
    }

private:
    static const std::byte* bytes_of(const Vec& here) { return reinterpret_cast<const std::byte*>(&here); }
    template <class Visit>
    void each_place(Visit visit) const {
        for (std::vector<Vec>* const array : arrays_()) {
            for (const std::uint32_t i : particles_) visit((*array)[i]);
        }
    }

    const std::function<std::vector<std::vector<Vec>*>()> arrays_;
    const std::vector<std::uint32_t> particles_;
};

/// Capabilities of a CPU backend. `target`: the instruction set in use, or the kind of arithmetic; `threads`:
/// how many threads run a step.
Capabilities cpu_capabilities(const std::string& target, int threads);

/// The first model name that a file like /proc/cpuinfo gives, or "unknown CPU" if it gives none.
std::string cpu_name(const std::filesystem::path& cpuinfo = "/proc/cpuinfo");
/// The numbers by which processors of one name differ, such as "family 25, model 17, stepping 1": a virtual
/// machine may hide which processor it has behind a general name. Empty if the file gives none.
std::string cpu_model(const std::filesystem::path& cpuinfo = "/proc/cpuinfo");

}  // namespace voxspring
