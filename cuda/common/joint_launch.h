// Launches whose blocks wait for each other (joint launches): the counters for these waits, and how the host
// learns that a wait was in vain.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <string>

#include "backends/layout/records/resident.h"
#include "backends/pace.h"
#include "cuda/device/buffer.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

class JointLaunch {
public:
    static constexpr int most_steps = 1 << 16;  ///< per launch

    /// `watched`: the device has a display, so that its driver ends kernels that run for seconds.
    explicit JointLaunch(bool watched) : watched_(watched) {}

    /// Resets the counters, the tag and the mark of a wait in vain, for the launches after an upload.
    void start_anew(const Stream& stream) {
        pace_.forget();
        started_blocks_.resize(1);
        started_blocks_.fill_with_zeros(stream);
        stall_.resize(1);
        *stall_.data() = 0;
        tag_ = launches_ = 0;
    }
    /// A counter for the blocks of `cuda_resident`, which read each other's state in memory at first.
    std::uint32_t* started_blocks() const { return started_blocks_.data(); }
    WaitLimit wait_limit() const { return {stall_.data(), max_wait_nanoseconds}; }

    /// Launches `count` steps: calls launch(steps, tag, launches) as often as needed, with at most `longest`
    /// steps each, and stepped(steps) after each launch. `tag` is the number of the latest step before this
    /// launch; `launches` counts launches since start_anew(), this one included. On a watched device launches
    /// are kept short (Pace): the host waits in `stream` for the first ones, to see how long they take.
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

    /// Calls launch(tag, launches) for a launch whose number of steps is not known yet. advance_tag() counts
    /// its steps as the host orders them.
    template <class Launch>
    void open(Launch launch) {
        launch(tag_, ++launches_);
    }
    void advance_tag(int steps) { tag_ += std::uint32_t(steps); }

    /// Empty, or a note that says which wait of a launch was in vain. Such a launch ends soon after. `block`:
    /// what to call a block in the note, for example "resident block".
    std::string failure_note(const std::string& block) const {
        if (stall_.size() == 0) return {};
        const std::uint64_t mark = *static_cast<const volatile std::uint64_t*>(stall_.data());
        if (mark == 0) return {};
        const ResidentStall stall = ResidentStall::unpacked(mark);
        return block + " " + std::to_string(stall.block) + " waited in vain for step " +
               std::to_string(stall.step) + " (counted since the body was last uploaded to the device) for " +
               std::to_string(max_wait_nanoseconds / 1'000'000'000) +
               " seconds: the block that it waited for did not run at the same time";
    }
    std::uint64_t bytes() const { return started_blocks_.bytes(); }

private:
    const bool watched_;
    Pace pace_{most_steps};
    Buffer<std::uint32_t> started_blocks_;
    Pinned<std::uint64_t> stall_;
    std::uint32_t tag_ = 0;       ///< number of the latest step ordered
    std::uint32_t launches_ = 0;  ///< since start_anew()
};

/// The work of a step within a joint launch, if `work` is the work of such a step that is launched alone. In
/// a joint launch the state leaves the multiprocessors only at the end, except increments that are kept in
/// memory, which do not count.
inline StepWork without_traffic(StepWork work) {
    work.bytes = work.written_bytes = work.footprint_bytes = 0;
    work.launches = 0;
    work.exchanges = 1;
    return work;
}

/// The most steps per launch. `monitored`: the state is checked for divergence between launches. If so, a
/// launch has few enough steps to find a divergence early. Beginning and ending a launch costs as much as
/// some ten steps, so about 1% of its 1024 steps.
inline int longest_joint_launch(bool monitored) { return monitored ? 1024 : JointLaunch::most_steps; }

}  // namespace voxspring::cuda
