// The argument of the resident kernel (cuda/kernels/resident.cu), whose tables resident_layout.h builds.
#pragma once

#include "backends/layout/records/implicit.h"
#include "backends/layout/records/ticks.h"
#include "backends/physics/neighbours.h"

namespace voxspring::layout {

/// A particle's position or displacement, or 12 bytes of one (cuda/kernels/border.h), on its way from one
/// block to another. The tag tells the reader whether the point has arrived (cuda/kernels/exchange.h).
struct alignas(16) TaggedPoint {
    Vector<float> point;
    std::uint32_t tag;
};

/// The border of a warp is the set of its springs that wait for points which other blocks send; kinds of
/// border are numbered. In kind 2 y + z, with y and z 0 or 1, the springs at dy = 1 wait if y is 1, and the
/// springs at dz = 1 wait if z is 1 (Across<y, z>). In kind mixed_border all springs wait.
inline constexpr int mixed_border = 4;
inline constexpr int border_kinds = 5;
/// Kinds 0 to 3 have no border at dy = -1 or dz = -1. A warp that would fit one of them if its border were at
/// dy = 1 instead of dy = -1 is mirrored along y: in its tables dy has the opposite sign. Warps are mirrored
/// along z likewise. So the warps of a block share the code of a few kinds, which the instruction cache
/// holds. An element of ResidentStep::border is the kind, in the bits `border_kind_bits`, plus mirrored_y and
/// mirrored_z if the warp is mirrored along these axes.
inline constexpr int border_kind_bits = 7;
inline constexpr int mirrored_y = 8;
inline constexpr int mirrored_z = 16;

/// The number of mask bits that stand for neighbours.
inline constexpr int neighbour_bits = 26;

/// A slot is the index of a point in the block's shared memory. A thread with one particle keeps the slots of
/// that particle's neighbours in registers. A thread with several particles reads the slots anew in each
/// step, this many at a time.
inline constexpr int slots_together = 4;
struct alignas(slots_together * sizeof(std::uint16_t)) SlotsTogether {
    std::uint16_t of[slots_together];
};
/// The index in ResidentStep::slot for mask bit `bit` of lane `at`, where a lane is a thread's place for one
/// particle. `together`: threads have several particles, so that slots_together successive bits of a lane lie
/// side by side.
VOXSPRING_HOST_DEVICE constexpr std::size_t slot_index(int bit, std::size_t at, std::size_t lane_count,
                                                       bool together) {
    if (!together) return std::size_t(bit) * lane_count + at;
    return (std::size_t(bit / slots_together) * lane_count + at) * slots_together +
           std::size_t(bit % slots_together);
}
/// The bit of an element of ResidentStep::own_slot that marks a pinned particle, if threads have several
/// particles.
inline constexpr std::uint16_t pinned_slot = 1U << 15;

/// Stands for "none" in tables of indices of 32 bits: for example in that of a lane without a particle, or of
/// a poll (a wait for one point of another block) that waits for nothing.
inline constexpr std::uint32_t resident_none = 0xFFFFFFFFu;

/// The bit of an element of ResidentStep::polled_word that makes a thread store a ghost in memory at the end
/// of a launch. A ghost is a particle that another part of the body steps. Of all polls of one ghost, one has
/// this bit.
inline constexpr std::uint32_t keeps_ghost = 1U << 31;
inline constexpr std::uint32_t resident_word_bits = keeps_ghost - 1;

/// The bit of an element of ResidentLinks::sent that is set if the point goes to the second of two
/// neighbouring parts.
inline constexpr std::uint32_t second_neighbour = 1U << 31;

/// The block that waited in vain, and the step whose points it waited for or, if it waited for no points, the
/// latest step, counted from the latest upload. If it waited in the kernel `exchange_borders`, `step` is the
/// number of the message instead. Both are packed into one word of 64 bits, so that they are written
/// together.
struct ResidentStall {
    std::uint32_t block, step;
    static constexpr std::uint64_t set = std::uint64_t(1) << 63;
    VOXSPRING_HOST_DEVICE std::uint64_t packed() const { return set | std::uint64_t(block) << 32 | step; }
    static VOXSPRING_HOST_DEVICE ResidentStall unpacked(std::uint64_t word) {
        return {std::uint32_t((word & ~set) >> 32), std::uint32_t(word)};
    }
};

/// How long one wait in a launch may last, and where it is reported that a wait took longer
/// (cuda/kernels/wait.h).
struct WaitLimit {
    std::uint64_t* stall;       ///< in the host's memory: a packed ResidentStall, or 0
    std::uint64_t nanoseconds;  ///< limit of one wait
    bool operator==(const WaitLimit&) const = default;
};
/// The limit of a wait. It is long because another process may have the card for some time slices, although a
/// step takes only microseconds.
inline constexpr std::uint64_t max_wait_nanoseconds = 10'000'000'000;

/// What the resident kernel is launched with, besides the state, the number of steps and two counters. Of the
/// base class, `nx` to `origins` and `active` are not used.
struct ResidentStep : ImplicitStep<float> {
    // Arrays with one element per lane, except `slot` and `border`. A lane is a thread's place for one
    // particle; all threads but pollers have the same number of lanes.
    const std::uint32_t* particle;  ///< index of the particle's word
    /// The index in `exchange` of a particle that other blocks need; resident_none for other particles.
    const std::uint32_t* published;
    const std::uint16_t* own_slot;
    /// For each mask bit (slot_index()): the slot of the neighbour, or the lane's own slot if no spring leads
    /// there.
    const std::uint16_t* slot;
    const std::uint8_t* border;  ///< one per 32 lanes: kind of border, and how they are mirrored
    // Arrays with one element per poll. A poller is a thread that waits for one point of another block in
    // each round. The polls are ordered by round, then by block, then by poller.
    const std::uint32_t* polled;       ///< index in `exchange`
    const std::uint32_t* polled_word;  ///< index of the polled particle's word
    const std::uint16_t* polled_slot;
    std::uint32_t lane_count;  ///< number of lanes of all blocks together
    /// The number of points in each half of `exchange`. Steps use the two halves in turn.
    std::uint32_t published_count;
    TaggedPoint* exchange;  ///< 2 x published_count points
    /// How many blocks have read the state with which their launch starts, counted since the upload.
    std::uint32_t* started_blocks;
    WaitLimit wait;
    bool operator==(const ResidentStep&) const = default;
};

/// The tool that a resident kernel is compiled for: none; one that stands still during a launch; or one that
/// the host moves from tick to tick while the launch goes on.
enum class ToolMode : std::uint8_t { none, launch, ticks };

/// A ResidentStep with a tool that holds particles.
struct HeldResidentStep : ResidentStep {
    const std::uint32_t* held_by_lane;  ///< per lane: index of its particle in `held`, or resident_none
    const HeldWord<float>* held;
    ToolState<float> tool;     ///< `moved` is used only in ToolMode::launch
    HeldForce<float>* forces;  ///< the tool's forces in the last step of a launch
    TickLine line;             ///< used in ToolMode::ticks
};

/// ResidentStep::exchange of a neighbouring part of the body. It may be in the memory of another device.
struct ResidentNeighbour {
    TaggedPoint* exchange;
    std::uint32_t words;  ///< points in each half of `exchange`; steps use the halves in turn
};
/// Where a part of a body sends points that the parts beside it need.
struct ResidentLinks {
    /// One element per lane: the index in the exchange of a neighbouring part at which the lane's point is
    /// stored, with second_neighbour set if it is the second part; resident_none: the point is not sent.
    const std::uint32_t* sent;
    ResidentNeighbour neighbour[2];
};
/// The argument of a launch that steps one part of a body, while other launches, on the same device or on
/// others, step the other parts. `Step` is ResidentStep or HeldResidentStep.
template <class Step>
struct PartStep : Step {
    ResidentLinks links;
};

/// The mask bit of the neighbour at offset (x, y, z).
VOXSPRING_HOST_DEVICE constexpr int bit_of(int x, int y, int z) {
#define BIT_IF(bit, dx, dy, dz) x == (dx) && y == (dy) && z == (dz) ? (bit):
    return FACE_NEIGHBOURS(BIT_IF) EDGE_NEIGHBOURS(BIT_IF) CORNER_NEIGHBOURS(BIT_IF) 0;
#undef BIT_IF
}

}  // namespace voxspring::layout
