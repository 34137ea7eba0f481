// Which blocks of voxels rest and may be left out of a step (kernels/resting.h), and whether it pays to find
// out.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "backends/backend.h"
#include "backends/layout/blocks.h"
#include "backends/rest_policy.h"
#include "cuda/device/buffer.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// The tuning parameter `rest` (rest_policy.h). `step`: every block is stepped. `skip`: blocks at rest are
/// left out, which changes no bit. `flush`: like `skip`, and displacements and increments below flushed_below
/// become zero. `auto` is meant to be the faster of `step` and `skip`. It is `step` with terms=all, with
/// gravity or a load, with fewer than min_blocks blocks, and if less than a third of the blocks are at rest
/// at the start. Otherwise it begins with `skip`, changes to `step` while fewer rest, and tries `skip` again
/// from time to time.
class Resting {
public:
    explicit Resting(const Options& options);

    /// Empty, or why the lattice is refused: it has more blocks of this shape than kernels that leave out
    /// blocks can index.
    std::string refused(const Lattice& lattice, BlockShape shape) const;
    /// An upper bound of the bytes that upload() allocates on the device.
    std::uint64_t bytes_needed(const Problem& problem, BlockShape shape) const;
    std::uint64_t bytes_held() const;

    /// Prepares a run that starts from `state`. The first step takes all blocks, unless start_checked() is
    /// called before that step.
    void upload(const Problem& problem, const State& state, BlockShape shape, const Stream& stream);
    /// The blocks for the start check, which is a step from the start that stores nothing.
    ActiveBlocks start_check() const;
    /// To be called after the start check is enqueued. The first step of each run then takes only the blocks
    /// that the check has listed: those that are not at rest at the start.
    void start_checked(const Stream& stream);
    /// Prepares a run that starts from the same state as the last one: the first step takes the same blocks.
    void rewind(const Stream& stream);
    /// Makes steps take all blocks until rewind() or the next upload. Does nothing and returns false if the
    /// tuning is `skip` or `flush`; otherwise returns true.
    bool stop();
    /// Makes the next step, which reads buffer `reading` of the particles, take all blocks.
    void wake(int reading, const Stream& stream);

    /// Whether steps leave out blocks at rest now or may do so later; checks() says whether the next step
    /// does.
    bool may_check() const { return policy_.may_check(); }
    bool checks() const { return policy_.checks(); }
    std::string choice() const { return policy_.choice(); }
    /// The terms of the kernel that leaves out blocks at rest.
    std::uint32_t terms() const { return term_resting | (rest_ == Rest::flush ? term_flush : 0); }
    /// The blocks for a step that reads buffer `reading`.
    ActiveBlocks active(int reading) const;

    /// How many steps may be enqueued before stepped() has to be called, which may change checks().
    int steps_to_decision() const { return policy_.steps_to_decision(); }
    /// To be called after `count` steps were enqueued. The next step reads buffer `reading`.
    void stepped(int count, int reading, const Stream& stream);

    std::size_t blocks() const { return all_.size(); }
    /// How many blocks the latest step took.
    std::size_t blocks_stepped(const Stream& stream) const;

private:
    /// With `auto`, fewer blocks than this are never checked: a step of them takes no longer than its launch.
    static constexpr std::size_t min_blocks = 512;

    /// Indices into Counts: the lengths of the lists for steps that read buffer 0 and buffer 1, and the
    /// values of ActiveBlocks::readers and ActiveBlocks::taken.
    enum Count : std::uint8_t { listed_for_0, listed_for_1, readers, taken, counts };
    using Counts = std::array<unsigned, counts>;

    /// Whether steps of `problem` may leave out blocks in some states.
    bool could_check(const Problem& problem, BlockShape shape) const;

    const Rest rest_;
    RestPolicy policy_;
    bool starts_checking_ = false;  ///< whether upload() decided that the run begins with checks
    int row_ = 0, slice_ = 0;
    Buffer<BlockOrigin> all_;  ///< blocks with particles
    /// Values for the marks of ActiveBlocks: all blocks are listed, and no block is.
    Buffer<std::uint32_t> all_marks_, no_marks_;
    Buffer<Counts> awake_counts_;  ///< counts for a step of all blocks: [b] if it reads buffer b
    // lists_ and marks_ have one element for steps that read buffer 0, one for steps that read buffer 1.
    std::array<Buffer<BlockOrigin>, 2> lists_;
    std::array<Buffer<std::uint32_t>, 2> marks_;
    Buffer<Counts> counts_;
    // The list, marks and counts that the start check has made, for every run from the same start.
    bool has_start_check_ = false;
    Buffer<BlockOrigin> first_list_;
    Buffer<std::uint32_t> first_marks_;
    Buffer<Counts> first_counts_;
    Pinned<Counts> seen_;  ///< a copy of `counts_`, some steps old
    Event copied_;         ///< recorded after the copy to `seen_`
    bool asked_ = false;
};

}  // namespace voxspring::cuda
