// The argument of the resident kernel (cuda/kernels/resident.cu), whose tables resident_layout.h builds.
#pragma once

#include "backends/layout/records/implicit.h"
#include "backends/layout/records/ticks.h"
#include "backends/physics/neighbours.h"

namespace voxspring::cuda {

/// A point on its way from block to block (cuda/kernels/exchange.h).
struct alignas(16) TaggedPoint {
    Vector<float> point;
    std::uint32_t tag;
};

/// How a warp's springs are split: 2 y + z of Across, or mixed: all wait for the border.
inline constexpr int mixed_border = 4;
inline constexpr int border_kinds = 5;
/// A warp whose border lies at -1 is mirrored: what its tables call (dx, dy, dz) is (dx, -dy, dz), or
/// (dx, dy, -dz), or both. So the warps of a block share the code of few kinds, which the instruction cache
/// holds.
inline constexpr int border_kind_bits = 7;
inline constexpr int mirrored_y = 8;
inline constexpr int mirrored_z = 16;

/// Mask bits of neighbours.
inline constexpr int neighbour_bits = 26;

/// A lane or poll without work.
inline constexpr std::uint32_t resident_none = 0xFFFFFFFFu;

/// In ResidentStep::polled_word, where a poll is of a ghost: the poller keeps in memory where a launch leaves
/// that. One poll of each ghost does.
inline constexpr std::uint32_t keeps_ghost = 1U << 31;
inline constexpr std::uint32_t resident_word_bits = keeps_ghost - 1;

/// In ResidentLinks::sent: the second neighbour is meant.
inline constexpr std::uint32_t second_neighbour = 1U << 31;

/// Which block waited in vain for which step, counted from the first that the tables were made for. It is one
/// word, so that it is written whole.
struct ResidentStall {
    std::uint32_t block, step;
    static constexpr std::uint64_t set = std::uint64_t(1) << 63;
    VOXSPRING_HOST_DEVICE std::uint64_t packed() const { return set | std::uint64_t(block) << 32 | step; }
    static VOXSPRING_HOST_DEVICE ResidentStall unpacked(std::uint64_t word) {
        return {std::uint32_t((word & ~set) >> 32), std::uint32_t(word)};
    }
};

/// How long a wait of a launch may last (cuda/kernels/wait.h).
struct WaitLimit {
    std::uint64_t* stall;       ///< on the host: a ResidentStall, or 0
    std::uint64_t nanoseconds;  ///< of one wait
    bool operator==(const WaitLimit&) const = default;
};
/// A step takes microseconds, and another process may have the card for some time slices.
inline constexpr std::uint64_t max_wait_nanoseconds = 10'000'000'000;

/// Everything a resident launch needs. The lattice of its base is not used.
struct ResidentStep : ImplicitStep<float> {
    // One a lane, `lanes` a block:
    const std::uint32_t* particle;   ///< word
    const std::uint32_t* published;  ///< index in `exchange`, for particles that other blocks reach
    const std::uint16_t* own_slot;
    const std::uint16_t* slot;   ///< of the neighbour of each mask bit, `lane_count` apart; absent: its own
    const std::uint8_t* border;  ///< kind of border and how it is mirrored, one per warp
    // One per poll, poller_rounds x blocks x pollers:
    const std::uint32_t* polled;       ///< index in `exchange`
    const std::uint32_t* polled_word;  ///< word of that particle
    const std::uint16_t* polled_slot;
    std::uint32_t lane_count;       ///< of all blocks
    std::uint32_t published_count;  ///< words of `exchange` for every second step
    TaggedPoint* exchange;          ///< 2 x published_count
    std::uint32_t* started_blocks;  ///< blocks that have read their start, of all launches
    WaitLimit wait;
    bool operator==(const ResidentStep&) const = default;
};

/// Whose tool a resident kernel is compiled for: nobody's; one that stands still for a launch; one that the
/// host moves while the launch goes on, between the ticks that it orders.
enum class ToolMode : std::uint8_t { none, launch, ticks };

/// A ResidentStep where a tool holds particles.
struct HeldResidentStep : ResidentStep {
    const std::uint32_t* held_by_lane;  ///< each lane's particle in `held`, or resident_none
    const HeldWord<float>* held;
    ToolState<float> tool;     ///< moved so in ToolMode::launch
    HeldForce<float>* forces;  ///< in the last step of a launch
    TickLine line;             ///< of ToolMode::ticks
};

/// The exchange of a part of a body beside this one, which may be in the memory of another device.
struct ResidentNeighbour {
    TaggedPoint* exchange;
    std::uint32_t words;  ///< for every second step
};
/// What a part of a body sends to those beside it.
struct ResidentLinks {
    /// One a lane: which word of a neighbour's exchange its point goes to, with second_neighbour where it is
    /// that one's; or resident_none.
    const std::uint32_t* sent;
    ResidentNeighbour neighbour[2];
};
/// The argument of a launch that steps a part of a body. `Step`: ResidentStep or HeldResidentStep.
template <class Step>
struct PartStep : Step {
    ResidentLinks links;
};

/// The mask bit of an offset.
VOXSPRING_HOST_DEVICE constexpr int bit_of(int x, int y, int z) {
#define BIT_IF(bit, dx, dy, dz) x == (dx) && y == (dy) && z == (dz) ? (bit):
    return FACE_NEIGHBOURS(BIT_IF) EDGE_NEIGHBOURS(BIT_IF) CORNER_NEIGHBOURS(BIT_IF) 0;
#undef BIT_IF
}

}  // namespace voxspring::cuda
