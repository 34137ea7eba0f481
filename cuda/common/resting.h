// Which blocks of an implicit kernel rest (kernels/resting.h), and whether it pays to know.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "backends/backend.h"
#include "backends/layout/blocks.h"
#include "backends/rest_policy.h"
#include "cuda/device/buffer.h"
#include "cuda/device/event.h"
#include "cuda/device/pinned.h"

namespace voxspring::cuda {

/// Values of the tuning parameter `rest`: every block is stepped (step); blocks at rest are not, which
/// changes no bit (skip), or displacements and increments below flushed_below are set to zero besides
/// (flush). As step or skip, whichever takes less (auto): skip where a start leaves a third of the blocks at
/// rest, until less than that rest, and again from time to time.
class Resting {
public:
    explicit Resting(const Options& options);

    /// Empty, or why `problem` has more blocks than can be named.
    std::string refused(const Lattice& lattice, BlockShape shape) const;
    /// Bytes on the device, at most.
    std::uint64_t bytes_needed(const Problem& problem, BlockShape shape) const;
    std::uint64_t bytes_held() const;

    /// The first step is to take all blocks of `problem`, in which `state` is.
    void upload(const Problem& problem, const State& state, BlockShape shape, const Stream& stream);
    /// The next step, which reads buffer `reading` of the particles, is to take all blocks.
    void wake(int reading, const Stream& stream);

    /// Whether steps leave out blocks at rest: at times, and now.
    bool may_check() const { return policy_.may_check(); }
    bool checks() const { return policy_.checks(); }
    /// Terms of the kernel that leaves them out.
    std::uint32_t terms() const { return term_resting | (rest_ == Rest::flush ? term_flush : 0); }
    /// For a step that reads buffer `reading`.
    ActiveBlocks active(int reading) const;

    /// Steps until checks() may change: of which at most that many are to be enqueued before stepped().
    int steps_to_decision() const { return policy_.steps_to_decision(); }
    /// That many were enqueued; the next one reads buffer `reading`.
    void stepped(int count, int reading, const Stream& stream);

    std::size_t blocks() const { return all_.size(); }
    /// Those that the latest step took.
    std::size_t blocks_stepped(const Stream& stream) const;

private:
    /// Blocks from which on it is asked at all: a step of less is as long as its launch.
    static constexpr std::size_t min_blocks = 512;

    /// counts_ on the device.
    enum Count : std::uint8_t { listed_for_0, listed_for_1, finished, taken, counts };
    using Counts = std::array<unsigned, counts>;

    /// Whether it is asked in some states of `problem`.
    bool could_check(const Problem& problem, BlockShape shape) const;

    const Rest rest_;
    RestPolicy policy_;
    int row_ = 0, slice_ = 0;
    Buffer<BlockOrigin> all_;                     ///< blocks with particles
    Buffer<std::uint32_t> all_marks_, no_marks_;  ///< of all blocks, and of none
    Buffer<Counts> awake_counts_;                 ///< before a step that takes all and reads buffer 0 or 1
    // For steps that read either buffer.
    std::array<Buffer<BlockOrigin>, 2> lists_;
    std::array<Buffer<std::uint32_t>, 2> marks_;
    Buffer<Counts> counts_;
    Pinned<Counts> seen_;  ///< counts of a while ago
    Event copied_;         ///< to `seen_`
    bool asked_ = false;
};

}  // namespace voxspring::cuda
