// Which block of the resident kernel (kernels/resident.cu) steps which particles, and where in shared memory
// these and the points that they reach lie. Built on the host, without a device.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "backends/layout/brick_layout.h"
#include "backends/layout/records/edit.h"
#include "backends/layout/records/resident.h"
#include "backends/physics/edit.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// How particles are dealt out to blocks: in equal numbers, by halving the body along its longest side again
/// and again; or in whole rows of 32 voxels, one warp per row, which keeps every neighbour along x within the
/// warp.
enum class Partition : std::uint8_t { automatic, bisection, rows };

/// The most that the kernel is made for, of threads with particles per block.
inline constexpr int max_resident_threads = 512;
inline constexpr int max_resident_turns = 4;  ///< particles per thread
inline constexpr int max_resident_rounds = 4;
inline constexpr int max_resident_slots = 2048;  ///< their points take 48 KiB of shared memory
inline constexpr int max_slots_in_ticks = 2016;  ///< whole warps that leave room for an order
/// The most points that a poller waits for where threads have several particles. The card then limits the
/// points.
inline constexpr int max_rounds_in_turns = 8;

/// The tables of ResidentStep. They follow from where particles are and have room for every spring that the
/// lattice may have, so edits leave them as they are.
struct ResidentLayout {
    bool in_rows = false;  ///< the partition: rows, or else a bisection
    int blocks = 0;
    int lanes = 0;  ///< per block: `turns` for each of whole warps of threads
    int turns = 1;  ///< particles of a thread, which it steps one after the other
    int pollers = 0;
    int rounds = 0;  ///< polls per poller
    int slots = 0;   ///< points in shared memory
    std::uint32_t border_kinds = 0;
    std::uint32_t published_count = 0;
    std::vector<std::uint32_t> particle, published, polled, polled_word;
    std::vector<std::uint16_t> own_slot, polled_slot;
    std::vector<std::uint16_t> neighbour_slot;  ///< ResidentStep::slot as if no spring were missing
    std::vector<std::uint8_t> border;
    std::vector<std::uint32_t> lane;  ///< of each particle; resident_none: a ghost
    /// For each of Problem::ghosts: where in the exchange the part that steps it puts its point, after the
    /// points that blocks of this part publish; or resident_none if no block reaches it.
    std::vector<std::uint32_t> ghost_word;

    int threads() const { return lanes / turns; }  ///< of a block, without pollers
    std::uint32_t lane_count() const { return std::uint32_t(blocks) * std::uint32_t(lanes); }
    std::size_t slot_index(int bit, std::size_t at) const {
        return layout::slot_index(bit, at, lane_count(), turns > 1);
    }
    /// What a block of the kernel for such a tool takes.
    std::size_t shared_bytes(ToolMode tool) const {
        return 2 * sizeof(Vector<float>) * std::size_t(slots) +
               (tool == ToolMode::ticks ? sizeof(TickOrder) : 0);
    }
    bool operator==(const ResidentLayout&) const = default;
};

/// What a launch may have on a card.
struct ResidentCard {
    int blocks;                          ///< multiprocessors
    std::size_t shared_bytes;            ///< of a block
    int threads = max_resident_threads;  ///< of a block, without pollers
};

/// `problem` has a lattice, at least one particle that is no ghost, and no springs beyond the lattice; masks
/// do not matter. Ghosts have no lane: blocks poll their points as they do those of other blocks. There are
/// at most as many blocks as `card` has. `automatic` takes rows if they waste at most a tenth of their lanes
/// and a block can hold its share.
///
/// If every thread can have one particle: `overlap`: if a whole warp can, springs within a block are added
/// while points from beyond its border are still on their way. Otherwise threads have several particles, and
/// those without neighbours in other blocks come first, whatever `overlap`.
ResidentLayout lay_out_resident(const Problem& problem, const ResidentCard& card, int pollers,
                                Partition partition, bool overlap);

/// ResidentStep::slot for springs as in `mask`, which is a Lattice::mask.
std::vector<std::uint16_t> slots_with(const ResidentLayout& layout, const std::vector<std::uint32_t>& mask);
/// ResidentStep::own_slot for pins as in `mask`.
std::vector<std::uint16_t> own_slots_with(const ResidentLayout& layout,
                                          const std::vector<std::uint32_t>& mask);

/// What an edit writes: first words of ResidentStep::slot, one of which may be written twice, then bits of
/// particles.
struct ResidentEdit {
    std::vector<EditedWord> words;
    std::size_t slots = 0;  ///< how many belong to ResidentStep::slot
};
/// `edit` changes springs of the lattice.
ResidentEdit resident_edit(const ResidentLayout& layout, const SpringEdit& edit);

/// What a part of a body sends to a part beside it: which of its particles and, for each, the word of that
/// part's exchange, or resident_none if no block there reads it.
struct ResidentSending {
    std::vector<std::uint32_t> particles, words;
};
/// Empty, or why lanes cannot send to these neighbours.
std::string sent_refusal(const std::vector<ResidentSending>& neighbours);
/// Makes ResidentLinks::sent.
std::vector<std::uint32_t> sent_by_lanes(const ResidentLayout& layout,
                                         const std::vector<ResidentSending>& neighbours);
/// ResidentLayout::ghost_word of some of the ghosts of `problem`, whose layout is `layout`.
std::vector<std::uint32_t> words_of_ghosts(const ResidentLayout& layout, const Problem& problem,
                                           const std::vector<std::uint32_t>& ghosts);

/// Empty, or why no layout of `problem` suits a card with `multiprocessors` multiprocessors.
/// `launches_together`: blocks may wait for each other.
std::string resident_refusal(const Problem& problem, int multiprocessors, bool launches_together);

/// Empty, or which limit of the kernel or of the card the layout exceeds.
std::string block_refusal(const ResidentLayout& layout, const ResidentCard& card,
                          ToolMode tool = ToolMode::none);

/// The predicted time of a step whose threads have several particles, on multiprocessors of that clock.
double seconds_in_turns(const ResidentLayout& layout, double hertz);
/// Empty, or how much faster bricks are predicted to step the same body. Empty as well if every thread has
/// one particle: such a layout has been measured beside bricks, and the rules of `auto` know its place.
/// `bricks`: the plan for the body, if bricks take it.
std::string outpaced_by_bricks(const ResidentLayout& layout, const std::optional<BrickPlan>& bricks,
                               double hertz);

/// For each lane the number of its particle in `held`, which is ascending; resident_none: it is not held.
std::vector<std::uint32_t> held_by_lanes(const ResidentLayout& layout,
                                         const std::vector<std::uint32_t>& held);

}  // namespace voxspring::layout
