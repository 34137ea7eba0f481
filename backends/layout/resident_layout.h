// Which block of the resident kernel (kernels/resident.cu) steps which particles, and in which slots of
// shared memory it keeps the points of these particles and of their neighbours. A resident kernel takes many
// steps per launch and keeps particles on the chip. All this is computed on the host, without a device.
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

/// How particles are dealt out to blocks. `bisection`: in numbers that differ by one at most, by cutting the
/// body across its longest side again and again. `rows`: in whole rows of 32 voxels, one warp per row, which
/// keeps neighbours along x within a warp, except at the ends of a row.
enum class Partition : std::uint8_t { automatic, bisection, rows };

/// The most threads with particles that a block may have. Pollers, threads that only wait for points of other
/// blocks, come on top.
inline constexpr int max_resident_threads = 512;
inline constexpr int max_resident_turns = 4;  ///< the most particles per thread
inline constexpr int max_resident_rounds = 4;
/// The most slots per block. A slot holds one point in each half of the block's shared memory; this many take
/// 48 KiB.
inline constexpr int max_resident_slots = 2048;
/// The most slots that leave room for a TickOrder in 48 KiB of shared memory, as a multiple of 32.
inline constexpr int max_slots_in_ticks = 2016;
/// Replaces max_resident_rounds if threads have several particles. In that case only the card's shared memory
/// limits the number of slots.
inline constexpr int max_rounds_in_turns = 8;

/// The tables of ResidentStep. They do not depend on which springs exist, and have an entry for every spring
/// that the lattice may have. So cuts and sutures change none of them.
struct ResidentLayout {
    bool in_rows = false;  ///< whether the partition is `rows`; otherwise it is `bisection`
    int blocks = 0;
    int lanes = 0;  ///< per block: places for particles, `turns` per thread, in whole warps
    int turns = 1;  ///< particles per thread, which steps them one after the other
    int pollers = 0;
    int rounds = 0;  ///< polls per poller in a step
    int slots = 0;   ///< per block: points in shared memory
    std::uint32_t border_kinds = 0;
    std::uint32_t published_count = 0;
    std::vector<std::uint32_t> particle, published, polled, polled_word;
    std::vector<std::uint16_t> own_slot, polled_slot;
    std::vector<std::uint16_t> neighbour_slot;  ///< ResidentStep::slot if no spring were missing
    std::vector<std::uint8_t> border;
    std::vector<std::uint32_t> lane;  ///< per particle: its lane; resident_none: a ghost
    /// For each of Problem::ghosts, the particles that another part of the body steps: the index in the
    /// exchange at which that part stores the ghost's point; resident_none: no block needs it. These indices
    /// come after those of the points that blocks of this part publish.
    std::vector<std::uint32_t> ghost_word;

    int threads() const { return lanes / turns; }  ///< per block, without pollers
    std::uint32_t lane_count() const { return std::uint32_t(blocks) * std::uint32_t(lanes); }
    std::size_t slot_index(int bit, std::size_t at) const {
        return layout::slot_index(bit, at, lane_count(), turns > 1);
    }
    /// The shared memory in bytes that a block takes if the kernel is compiled for `tool`.
    std::size_t shared_bytes(ToolMode tool) const {
        return 2 * sizeof(Vector<float>) * std::size_t(slots) +
               (tool == ToolMode::ticks ? sizeof(TickOrder) : 0);
    }
    bool operator==(const ResidentLayout&) const = default;
};

/// The most that a launch may have on a card.
struct ResidentCard {
    int blocks;                          ///< one per multiprocessor
    std::size_t shared_bytes;            ///< per block
    int threads = max_resident_threads;  ///< per block, without pollers
};

/// Makes the tables for a problem with a lattice, at least one particle that is no ghost, and no springs
/// beyond the lattice; masks do not matter. Ghosts have no lane: blocks poll their points as they poll those
/// of other blocks. There are at most `card.blocks` blocks. The result may exceed other limits of the card or
/// the kernel (block_refusal()). Partition `automatic` tries rows before bisection if rows waste at most a
/// tenth of their lanes.
///
/// If there are enough threads, each has one particle, unless block_refusal() rules that out; otherwise each
/// has several. With `overlap` a warp whose threads have one particle each adds springs within its block
/// while points of other blocks are still on their way, if all its particles have their border on the same
/// sides (ResidentStep::border). If threads have several particles, those (with rows, whole rows) without
/// neighbours in other blocks come first, whatever `overlap` is.
ResidentLayout lay_out_resident(const Problem& problem, const ResidentCard& card, int pollers,
                                Partition partition, bool overlap);

/// Makes ResidentStep::slot. `mask`, a Lattice::mask, says which springs exist.
std::vector<std::uint16_t> slots_with(const ResidentLayout& layout, const std::vector<std::uint32_t>& mask);
/// Makes ResidentStep::own_slot. `mask`, a Lattice::mask, says which particles are pinned.
std::vector<std::uint16_t> own_slots_with(const ResidentLayout& layout,
                                          const std::vector<std::uint32_t>& mask);

/// The words that an edit writes to the device: first words of ResidentStep::slot, some of them perhaps
/// twice, then the bits of particles.
struct ResidentEdit {
    std::vector<EditedWord> words;
    std::size_t slots = 0;  ///< how many of `words` belong to ResidentStep::slot
};
/// `edit` must change only springs of the lattice.
ResidentEdit resident_edit(const ResidentLayout& layout, const SpringEdit& edit);

/// What a part of a body sends to one part beside it: which of its particles and, for each, the index in that
/// part's exchange, or resident_none if no block there reads the particle.
struct ResidentSending {
    std::vector<std::uint32_t> particles, words;
};
/// Empty, or why this part cannot send to all of `neighbours`.
std::string sent_refusal(const std::vector<ResidentSending>& neighbours);
/// Makes ResidentLinks::sent: where each lane's point goes.
std::vector<std::uint32_t> sent_by_lanes(const ResidentLayout& layout,
                                         const std::vector<ResidentSending>& neighbours);
/// Selects the elements of ResidentLayout::ghost_word for `ghosts`, some of the ghosts of `problem`.
std::vector<std::uint32_t> words_of_ghosts(const ResidentLayout& layout, const Problem& problem,
                                           const std::vector<std::uint32_t>& ghosts);

/// Empty, or why the resident kernel cannot step `problem` on a card with `multiprocessors` multiprocessors.
/// `launches_together`: the device can run all blocks of a launch at once.
std::string resident_refusal(const Problem& problem, int multiprocessors, bool launches_together);

/// Empty, or which limit of the kernel or of the card the layout exceeds.
std::string block_refusal(const ResidentLayout& layout, const ResidentCard& card,
                          ToolMode tool = ToolMode::none);

/// The predicted seconds of a step in which threads have several particles. `hertz`: clock of the
/// multiprocessors.
double seconds_in_turns(const ResidentLayout& layout, double hertz);
/// Empty, or a note that cuda_bricks is predicted to step the same body faster, with both times. Also empty
/// if every thread has one particle: such layouts have been measured, and the rules of the backend `auto`
/// already rank them against cuda_bricks. `bricks`: the plan of cuda_bricks for the body, if there is one.
std::string outpaced_by_bricks(const ResidentLayout& layout, const std::optional<BrickPlan>& bricks,
                               double hertz);

/// For each lane the index of its particle in `held`, which ascends; resident_none: the particle is not held.
std::vector<std::uint32_t> held_by_lanes(const ResidentLayout& layout,
                                         const std::vector<std::uint32_t>& held);

}  // namespace voxspring::layout
