// Launches whose blocks wait for each other: what they count, and how the host learns that one of them waited
// in vain.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <string>

#include "backends/layout/records/resident.h"
#include "backends/pace.h"
#include "cuda/device/buffer.h"
#include "cuda/device/pinned.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

class JointLaunch {
public:
    static constexpr int most_steps = 1 << 16;  ///< of one launch

    /// `watched`: the device has a display, so that its driver ends kernels that run for seconds.
    explicit JointLaunch(bool watched) : watched_(watched) {}

    /// Resets what the arguments of the next launches refer to.
    void start_anew(const Stream& stream) {
        pace_.forget();
        started_blocks_.resize(1);
        started_blocks_.fill_with_zeros(stream);
        stall_.resize(1);
        *stall_.data() = 0;
        tag_ = launches_ = 0;
    }
    std::uint32_t* started_blocks() const { return started_blocks_.data(); }
    WaitLimit wait_limit() const { return {stall_.data(), max_wait_nanoseconds}; }

    /// Calls launch(steps, tag, launches) until `count` steps are launched, with no more than `longest` each,
    /// and after each launch stepped(steps). On a watched device launches are kept short (Pace): the first
    /// ones since start_anew() are waited for in `stream`, to see how long they take.
    template <class Launch, class Stepped>
    void enqueue(int count, int longest, const Stream& stream, Launch launch, Stepped stepped) {
        while (count > 0) {
            const int steps = std::min({count, longest, watched_ ? pace_.steps() : count});
            const bool measures = watched_ && pace_.is_unknown();
            if (measures) stream.synchronize();
            const auto begin = std::chrono::steady_clock::now();
            launch(steps, tag_, ++launches_);
            if (measures) {
                stream.synchronize();
                pace_.measured(
                    steps, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
            }
            tag_ += std::uint32_t(steps);
            count -= steps;
            stepped(steps);
        }
    }

    /// Calls launch(tag, launches) for a launch that does not know how many steps it will take. advance_tag()
    /// counts them as they are ordered.
    template <class Launch>
    void open(Launch launch) {
        launch(tag_, ++launches_);
    }
    void advance_tag(int steps) { tag_ += std::uint32_t(steps); }

    /// Empty, or which wait a launch has reported to be in vain. Such a launch ends soon after. `block`: what
    /// to call a block in the note, for example "resident block".
    std::string failure_note(const std::string& block) const {
        if (stall_.size() == 0) return {};
        const std::uint64_t mark = *static_cast<const volatile std::uint64_t*>(stall_.data());
        if (mark == 0) return {};
        const ResidentStall stall = ResidentStall::unpacked(mark);
        return block + " " + std::to_string(stall.block) + " waited in vain for step " +
               std::to_string(stall.step) + " since the latest upload, for " +
               std::to_string(max_wait_nanoseconds / 1'000'000'000) +
               " seconds: what it waits for did not run at the same time";
    }
    std::uint64_t bytes() const { return started_blocks_.bytes(); }

private:
    const bool watched_;
    Pace pace_{most_steps};
    Buffer<std::uint32_t> started_blocks_;
    Pinned<std::uint64_t> stall_;
    std::uint32_t tag_ = 0;       ///< of the latest point published
    std::uint32_t launches_ = 0;  ///< since start_anew()
};

/// The most steps per launch. With divergence checks between launches, so few that a divergence is found
/// early, and so many that a launch, which takes as long as some ten steps, costs 1% at most.
inline int longest_joint_launch(bool monitored) { return monitored ? 1024 : JointLaunch::most_steps; }

}  // namespace voxspring::cuda
