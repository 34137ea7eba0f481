// A slab on a backend, which after each step hands its border on and takes its neighbours'.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/slabs.h"
#include "harness/ranks/exchange.h"

namespace voxspring {

/// Where the time of a rank's steps went.
struct RankSeconds {
    double compute = 0;   ///< stepping
    double exchange = 0;  ///< reading, sending and writing borders
    double waiting = 0;   ///< until the neighbours' borders were there
};

/// Steps a slab as `inner` steps any problem. All ranks make as many steps and the same edits.
class RankBackend final : public Backend {
public:
    /// All must outlive it.
    RankBackend(Backend& inner, const Slab& slab, Exchange& exchange)
        : inner_(inner), slab_(slab), exchange_(exchange) {}

    Capabilities capabilities() const override { return inner_.capabilities(); }
    std::string unsupported(const Problem& problem) const override;
    void upload(const Problem& problem, const State& state) override;
    void edit(const Problem& edited, const SpringEdit& edit) override { inner_.edit(edited, edit); }
    bool has_tool() const override { return inner_.has_tool(); }
    void move_tool(const glm::dvec3& displacement) override { inner_.move_tool(displacement); }
    /// Of what the tool holds of this slab.
    glm::dvec3 tool_force() override { return inner_.tool_force(); }
    void step(int count) override;
    void monitor(const DivergenceMonitor& monitor) override { inner_.monitor(monitor); }
    std::optional<Divergence> divergence() override { return inner_.divergence(); }
    void synchronize() override { inner_.synchronize(); }
    State download() override { return inner_.download(); }
    DeviceLimits measure_limits() override { return inner_.measure_limits(); }
    StepWork step_work(const Problem& problem) const override { return inner_.step_work(problem); }

    /// What follows every step: borders go to the neighbours, and theirs to the ghosts.
    void exchange_borders();
    /// Since the latest call of this.
    RankSeconds take_seconds() { return std::exchange(seconds_, {}); }
    /// Of the largest message of a step.
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

    Backend& inner_;
    const Slab& slab_;
    Exchange& exchange_;
    std::vector<Link> links_;
    RankSeconds seconds_;
    Clock::time_point begin_, end_;
};

}  // namespace voxspring
