// Steps one rank's subdomain on a backend. After each step it sends the subdomain's borders and receives
// those of its neighbours, unless borders travel within steps.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/decomposition.h"
#include "harness/base/clock.h"
#include "harness/ranks/exchange.h"

namespace voxspring {

/// What ranks share whose borders go from device to device. They are threads of one process.
struct PartsOnDevices {
    explicit PartsOnDevices(std::size_t ranks) : borders(ranks) {}

    std::vector<std::shared_ptr<DeviceBorders>> borders;  ///< element r belongs to rank r
    std::atomic<bool> all_keep_start = true;              ///< false once a rank could not
};

/// Where the time of a rank's steps went, in seconds. If borders go from device to device, the wait for the
/// neighbours' borders counts as `exchange` or, if borders travel within steps, as `compute`. `waiting` then
/// has only the wait for all ranks to begin.
struct RankSeconds {
    double compute = 0;   ///< stepping
    double exchange = 0;  ///< reading, sending and writing borders
    double waiting = 0;   ///< waiting for the neighbours
};

/// Steps a subdomain with the backend `inner`. All ranks make the same number of steps and the same edits.
class RankBackend final : public Backend, public ToolFacet {
public:
    /// All arguments must outlive this object. If `parts` is not null, borders go from device to device by
    /// `way`, one of Capabilities::border_ways. In that case all ranks must meet() and connect() after each
    /// upload(), before anything else but keep_start().
    RankBackend(Backend& inner, const Subdomain& subdomain, Exchange& exchange, std::string way = {},
                PartsOnDevices* parts = nullptr)
        : inner_(inner), subdomain_(subdomain), exchange_(exchange), way_(std::move(way)), parts_(parts) {}

    Capabilities capabilities() const override { return inner_.capabilities(); }
    std::string unsupported(const Problem& problem) const override;
    void upload(const Problem& problem, const State& state) override;
    /// If borders go from device to device, all ranks must call this at the same time, and all get the same
    /// answer: a rank that uploads makes new borders, and the others have to connect with these.
    bool keep_start() override;
    void rewind() override { inner_.rewind(); }
    /// Does nothing for an edit that changes no spring of this subdomain. All ranks must call edit() for
    /// every edit nevertheless.
    void edit(const Problem& edited, const SpringEdit& edit) override {
        if (!edit.empty()) inner_.edit(edited, edit);
    }
    ToolFacet* tool() override { return inner_.tool() != nullptr ? this : nullptr; }
    void move_tool(const glm::dvec3& displacement) override {
        if (is_held_) inner_.tool()->move_tool(displacement);
    }
    /// The force on the tool by the particles that are stepped here.
    glm::dvec3 tool_force() override { return inner_.tool()->tool_force(); }
    /// All ranks must make the same steps, edits and moves of the tool, in the same order.
    void step(int count) override;
    void monitor(const DivergenceMonitor& monitor) override { inner_.monitor(monitor); }
    std::optional<Divergence> divergence() override { return inner_.divergence(); }
    void synchronize() override { inner_.synchronize(); }
    State download() override { return inner_.download(); }
    LimitsFacet* limits() override { return inner_.limits(); }

    /// If borders go from device to device, connects with all other ranks, unless that was done since the
    /// latest upload().
    void connect();
    /// Ends what connect() began. To be called when all ranks have met after the last step, if none failed.
    void disconnect();
    /// Sends borders to the neighbours, and writes the neighbours' borders to the ghosts (the copies that
    /// this rank has of their particles). Unless exchanges_in_steps(), step() does this after each step. If
    /// borders go from device to device, may return before the transfers are done.
    void exchange_borders();
    /// Sets whether the host waits for the device after each part of a step, so that take_seconds() can tell
    /// the parts apart. If borders go through the host's memory, the host always waits; otherwise it does not
    /// wait unless this function sets it.
    void wait_in_steps(bool wait) { waits_ = wait || parts_ == nullptr; }
    bool goes_by_device() const { return parts_ != nullptr; }
    /// Whether borders travel within steps, so that their exchange cannot be timed separately.
    bool exchanges_in_steps() const { return steps_per_call() > 0; }
    /// The time spent since the previous call of this function.
    RankSeconds take_seconds() { return std::exchange(seconds_, {}); }
    /// The ranks that this rank exchanges borders with.
    std::vector<int> neighbours() const;
    /// The bytes that this rank sends per step.
    std::size_t border_bytes() const;

private:
    /// The border with another rank: own particles that are sent, and ghosts that are received.
    struct Link {
        int rank;
        std::unique_ptr<Border> sent, received;
    };

    void mark(Mark which) override { (which == Mark::begin ? begin_ : end_) = Clock::now(); }
    double seconds_between_marks() const override { return Seconds(end_ - begin_).count(); }

    /// Requires goes_by_device().
    std::shared_ptr<DeviceBorders>& own_borders() const {
        return parts_->borders.at(std::size_t(exchange_.rank()));
    }
    int steps_per_call() const;
    void step_alone(int count);
    /// Calls enqueue() when all ranks are ready to, and returns once all have done so.
    template <class Enqueue>
    void step_together(Enqueue enqueue);
    void exchange_by_host();
    void exchange_by_device();

    Backend& inner_;
    const Subdomain& subdomain_;
    bool is_held_ = false;  ///< whether the problem has a tool
    Exchange& exchange_;
    const std::string way_;
    PartsOnDevices* const parts_;  ///< null: borders go through the host's memory
    bool connected_ = false;
    bool waits_ = parts_ == nullptr;
    std::vector<Link> links_;  ///< used if borders go through the host's memory
    RankSeconds seconds_;
    Clock::time_point begin_, end_;
};

}  // namespace voxspring
