// Which blocks of an implicit kernel rest (kernels/resting.h), and whether it pays to ask.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>

#include "backends/backend.h"
#include "cuda/device/buffer.h"
#include "cuda/device/event.h"
#include "cuda/device/pinned.h"
#include "cuda/layout.h"

namespace voxspring::cuda {

/// Values of the tuning parameter `rest`: every block is stepped (step); blocks at rest are not, which
/// changes no bit (skip), or displacements and increments below flushed_below are set to zero besides
/// (flush). As step or skip, whichever takes less (auto): skip where a start leaves a quarter of the blocks
/// at rest, until less than that rest, and again from time to time.
class Resting {
public:
    /// Throws BadSpecification if the formulation has nothing to flush.
    static void check(const Options& options);
    explicit Resting(const Options& options);

    /// Empty, or why `problem` has more blocks than can be named.
    std::string refused(const Lattice& lattice, BlockShape shape) const;
    /// Bytes on the device.
    std::uint64_t bytes_needed(const Lattice& lattice, BlockShape shape) const;
    std::uint64_t bytes_held() const;

    /// All blocks of `problem`, in which `state` is, are to be stepped.
    void upload(const Problem& problem, const State& state, BlockShape shape, const Stream& stream);
    /// The next step takes all blocks.
    void wake(const Stream& stream);

    /// Whether steps leave out blocks at rest: at times, and now.
    bool may_look() const { return may_look_; }
    bool looks() const { return looking_; }
    /// Terms of the kernel that looks.
    std::uint32_t terms() const { return term_resting | (way_ == Way::flush ? term_flush : 0); }
    /// Lists the blocks that a step which reads buffer `reading` of the particles is to take.
    void enqueue_list(int reading, const Stream& stream) const;
    /// For that step.
    BlockReports reports(int reading) const;
    LivelyBlocks lively(int reading) const;

    /// Steps until looks() may change: of which at most that many are to be enqueued before stepped().
    int steps_to_decision() const { return decides() ? left_ : std::numeric_limits<int>::max(); }
    /// That many were enqueued, and led to buffer `current`.
    void stepped(int count, int current, const Stream& stream);

    std::size_t blocks() const { return all_.size(); }
    /// Those that the step which led to buffer `current` took.
    std::size_t blocks_stepped(int current, const Stream& stream) const;

private:
    enum class Way : std::uint8_t { step, decide, skip, flush };

    /// Steps between looks at how many blocks rest. The host waits for the one before the latest, so that
    /// the device has steps to do meanwhile.
    static constexpr int period = 64;
    /// Steps without looking once that did not pay.
    static constexpr int shortest_pause = 256, longest_pause = 4096;
    /// Blocks from which on it is asked at all: a step of less is as long as its launch.
    static constexpr std::size_t least_blocks = 512;

    bool decides() const { return way_ == Way::decide && may_look_; }
    /// On an H200 looking costs a step of all blocks 9 to 18%, and a block that is left out up to 21% of one
    /// that is stepped: it pays from 17% on.
    static bool pays(std::size_t lively, std::size_t blocks) { return 4 * lively <= 3 * blocks; }

    const Way way_;
    bool may_look_ = false, looking_ = false;
    int row_ = 0, slice_ = 0;
    Buffer<BlockOrigin> all_;                       ///< blocks with particles
    Buffer<BlockOrigin> listed_;                    ///< those that a step takes
    Buffer<unsigned> counts_;                       ///< how many, of steps that read either buffer
    Buffer<std::uint64_t> awake_;                   ///< reports by which all blocks with particles are lively
    std::array<Buffer<std::uint64_t>, 2> reports_;  ///< of the steps that led to either buffer
    Pinned<std::uint64_t> seen_;                    ///< reports of a while ago
    Event copied_;                                  ///< to `seen_`
    bool asked_ = false;
    int left_ = 0, pause_ = 0;
};

}  // namespace voxspring::cuda
