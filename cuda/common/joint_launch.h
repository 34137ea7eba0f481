// Launches whose blocks wait for each other: what they count, and how the host hears of one that waited in
// vain.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

#include "backends/layout/records/resident.h"
#include "cuda/device/buffer.h"
#include "cuda/device/pinned.h"

namespace voxspring::cuda {

class JointLaunch {
public:
    /// For the arguments of the launches from now on.
    void start_anew(const Stream& stream) {
        started_blocks_.resize(1);
        started_blocks_.fill_with_zeros(stream);
        stall_.resize(1);
        *stall_.data() = 0;
        tag_ = launches_ = 0;
    }
    std::uint32_t* started_blocks() const { return started_blocks_.data(); }
    std::uint64_t* stall() const { return stall_.data(); }

    /// Calls launch(steps, tag, launches) for `count` steps, of no more than `longest` each; then
    /// `stepped(steps)`.
    template <class Launch, class Stepped>
    void enqueue(int count, int longest, Launch launch, Stepped stepped) {
        while (count > 0) {
            const int steps = std::min(count, longest);
            launch(steps, tag_, ++launches_);
            tag_ += std::uint32_t(steps);
            count -= steps;
            stepped(steps);
        }
    }

    /// Calls launch(tag, launches) for a launch that does not know how many steps it takes. They are counted
    /// when it is asked for them.
    template <class Launch>
    void open(Launch launch) {
        launch(tag_, ++launches_);
    }
    void asked_for(int steps) { tag_ += std::uint32_t(steps); }

    /// Empty, or what a launch that gave up has said, once it has ended. `block`: "resident block".
    std::string failure_note(const std::string& block) const {
        if (stall_.size() == 0 || *stall_.data() == 0) return {};
        const ResidentStall stall = ResidentStall::unpacked(*stall_.data());
        return block + " " + std::to_string(stall.block) + " waited in vain for step " +
               std::to_string(stall.step) + " since the latest upload";
    }
    std::uint64_t bytes() const { return started_blocks_.bytes(); }

private:
    Buffer<std::uint32_t> started_blocks_;
    Pinned<std::uint64_t> stall_;
    std::uint32_t tag_ = 0;       ///< of the latest point published
    std::uint32_t launches_ = 0;  ///< since start_anew()
};

/// Steps of a launch: with divergence checks between them, often enough to find it early, and seldom enough
/// that a launch costs 1% at most, since it takes as long as some ten steps.
inline int longest_joint_launch(bool monitored) { return monitored ? 1024 : 1 << 16; }

}  // namespace voxspring::cuda
