// A subdomain on a backend, which after each step hands its borders on and takes its neighbours'.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/decomposition.h"
#include "harness/ranks/exchange.h"

namespace voxspring {

/// What ranks of one process have from device to device, by their numbers.
using PartsOnDevices = std::vector<std::shared_ptr<DeviceBorders>>;

/// Where the time of a rank's steps went.
struct RankSeconds {
    double compute = 0;   ///< stepping
    double exchange = 0;  ///< reading, sending and writing borders
    double waiting = 0;   ///< until the neighbours' borders were there
};

/// Steps a subdomain as `inner` steps any problem. All ranks make as many steps and the same edits.
class RankBackend final : public Backend {
public:
    /// All must outlive it.
    RankBackend(Backend& inner, const Subdomain& subdomain, Exchange& exchange)
        : inner_(inner), subdomain_(subdomain), exchange_(exchange) {}
    /// The same with borders that go from device to device, by `way` (Capabilities::border_ways). After each
    /// upload() ranks are to meet and to connect(), before anything else.
    RankBackend(Backend& inner, const Subdomain& subdomain, Exchange& exchange, std::string way,
                PartsOnDevices& parts)
        : inner_(inner), subdomain_(subdomain), exchange_(exchange), way_(std::move(way)), parts_(&parts) {}

    Capabilities capabilities() const override { return inner_.capabilities(); }
    std::string unsupported(const Problem& problem) const override;
    void upload(const Problem& problem, const State& state) override;
    bool keep_start() override { return inner_.keep_start(); }
    void rewind() override { inner_.rewind(); }
    /// Nothing where the edit changes no spring here: ranks make their calls alike, see step().
    void edit(const Problem& edited, const SpringEdit& edit) override {
        if (!edit.empty()) inner_.edit(edited, edit);
    }
    bool has_tool() const override { return inner_.has_tool(); }
    void move_tool(const glm::dvec3& displacement) override {
        if (is_held_) inner_.move_tool(displacement);
    }
    /// Of what the tool holds of this subdomain.
    glm::dvec3 tool_force() override { return inner_.tool_force(); }
    /// All ranks call this alike, with edits and moves of the tool between.
    void step(int count) override;
    void monitor(const DivergenceMonitor& monitor) override { inner_.monitor(monitor); }
    std::optional<Divergence> divergence() override { return inner_.divergence(); }
    void synchronize() override { inner_.synchronize(); }
    State download() override { return inner_.download(); }
    DeviceLimits measure_limits() override { return inner_.measure_limits(); }
    StepWork step_work(const Problem& problem) const override { return inner_.step_work(problem); }

    /// With the parts of all other ranks, where borders go from device to device; nothing where that has been
    /// done since the latest upload().
    void connect();
    /// After all steps of a run in which nothing failed, once all ranks have met.
    void disconnect();
    /// What follows every step: borders go to the neighbours, and theirs to the ghosts. From device to device
    /// this returns before they have gone.
    void exchange_borders();
    /// Whether the host waits for the device after each part of a step, so that take_seconds() can tell them
    /// apart; at first where borders go through its memory. There it does in any case.
    void wait_in_steps(bool wait) { waits_ = wait || parts_ == nullptr; }
    bool goes_by_device() const { return parts_ != nullptr; }
    /// Whether borders travel within steps, so that their exchange takes no time of its own.
    bool exchanges_in_steps() const { return steps_a_call() > 0; }
    /// Since the latest call of this.
    RankSeconds take_seconds() { return std::exchange(seconds_, {}); }
    /// The ranks that it exchanges borders with.
    std::vector<int> neighbours() const;
    /// Of all that it sends in a step.
    std::size_t border_bytes() const;

private:
    using Clock = std::chrono::steady_clock;
    /// Both sides of a border.
    struct Link {
        int rank;
        std::unique_ptr<Border> sent, received;
    };

    void mark(Mark which) override { (which == Mark::begin ? begin_ : end_) = Clock::now(); }
    double seconds_between_marks() const override {
        return std::chrono::duration<double>(end_ - begin_).count();
    }

    int steps_a_call() const;
    void step_alone(int count);
    void step_and_exchange(int count);
    void exchange_by_host();
    void exchange_by_device();

    Backend& inner_;
    const Subdomain& subdomain_;
    bool is_held_ = false;  ///< by the tool
    Exchange& exchange_;
    const std::string way_ = {};
    PartsOnDevices* const parts_ = nullptr;  ///< null: borders go through the host's memory
    bool connected_ = false;
    bool waits_ = parts_ == nullptr;
    std::vector<Link> links_;  ///< through the host's memory
    RankSeconds seconds_;
    Clock::time_point begin_, end_;
};

}  // namespace voxspring
