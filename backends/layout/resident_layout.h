// Which block of the resident kernel (kernels/resident.cu) steps which particles, and in which slots of
// shared memory it keeps the points of these particles and of their neighbours. Built on the host, without a
// device.
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

/// The kernel's limit of threads per block that have particles.
inline constexpr int max_resident_threads = 512;
inline constexpr int max_resident_turns = 4;  ///< the most particles per thread
inline constexpr int max_resident_rounds = 4;
/// Slots per block; their points take 48 KiB of shared memory.
inline constexpr int max_resident_slots = 2048;
/// The most slots that leave room for a TickOrder in 48 KiB, in whole warps.
inline constexpr int max_slots_in_ticks = 2016;
/// Replaces max_resident_rounds if threads have several particles. Then only the card's shared memory limits
/// the number of slots.
inline constexpr int max_rounds_in_turns = 8;

/// The tables of ResidentStep. They follow from where particles are, and have room for every spring that the
/// lattice may have. So an edit changes none of them.
struct ResidentLayout {
    bool in_rows = false;  ///< whether the partition is `rows`; otherwise it is `bisection`
    int blocks = 0;
    int lanes = 0;  ///< per block: `turns` per thread, and threads make whole warps
    int turns = 1;  ///< particles per thread, which steps them one after the other
    int pollers = 0;
    int rounds = 0;  ///< polls per poller
    int slots = 0;   ///< per block: points in shared memory
    std::uint32_t border_kinds = 0;
    std::uint32_t published_count = 0;
    std::vector<std::uint32_t> particle, published, polled, polled_word;
    std::vector<std::uint16_t> own_slot, polled_slot;
    std::vector<std::uint16_t> neighbour_slot;  ///< ResidentStep::slot if no spring were missing
    std::vector<std::uint8_t> border;
    std::vector<std::uint32_t> lane;  ///< per particle: its lane; resident_none: a ghost
    /// For each of Problem::ghosts: the index in the exchange at which the part that steps the ghost stores
    /// the ghost's point; resident_none: no block reaches it. These indices come after those of points that
    /// blocks of this part publish.
    std::vector<std::uint32_t> ghost_word;

    int threads() const { return lanes / turns; }  ///< per block, without pollers
    std::uint32_t lane_count() const { return std::uint32_t(blocks) * std::uint32_t(lanes); }
    std::size_t slot_index(int bit, std::size_t at) const {
        return layout::slot_index(bit, at, lane_count(), turns > 1);
    }
    /// Bytes of shared memory per block of a kernel that is compiled for `tool`.
    std::size_t shared_bytes(ToolMode tool) const {
        return 2 * sizeof(Vector<float>) * std::size_t(slots) +
               (tool == ToolMode::ticks ? sizeof(TickOrder) : 0);
    }
    bool operator==(const ResidentLayout&) const = default;
};

/// What a launch may have on a card.
struct ResidentCard {
    int blocks;                          ///< number of multiprocessors
    std::size_t shared_bytes;            ///< per block
    int threads = max_resident_threads;  ///< per block, without pollers
};

/// `problem` has a lattice, at least one particle that is no ghost, and no springs beyond the lattice; masks
/// do not matter. Ghosts have no lane: blocks poll their points as they do those of other blocks. There are
/// at most `card.blocks` blocks. They may exceed other limits of the card or the kernel (block_refusal()).
/// `automatic` takes rows if they waste at most a tenth of their lanes and the rows of every block fit into
/// it.
///
/// If there are enough threads, each has one particle. With `overlap` a warp then adds springs within its
/// block while points from beyond the border are still on their way, if the border of the whole warp allows
/// it. Otherwise threads have several particles, and particles without neighbours in other blocks come first,
/// whatever `overlap` is.
ResidentLayout lay_out_resident(const Problem& problem, const ResidentCard& card, int pollers,
                                Partition partition, bool overlap);

/// ResidentStep::slot for the springs that `mask`, a Lattice::mask, has.
std::vector<std::uint16_t> slots_with(const ResidentLayout& layout, const std::vector<std::uint32_t>& mask);
/// ResidentStep::own_slot for the particles that `mask`, a Lattice::mask, marks as pinned.
std::vector<std::uint16_t> own_slots_with(const ResidentLayout& layout,
                                          const std::vector<std::uint32_t>& mask);

/// The words that an edit writes: first words of ResidentStep::slot, of which a word may occur twice, then
/// bits of particles.
struct ResidentEdit {
    std::vector<EditedWord> words;
    std::size_t slots = 0;  ///< how many of `words` belong to ResidentStep::slot
};
/// `edit` must change only springs of the lattice.
ResidentEdit resident_edit(const ResidentLayout& layout, const SpringEdit& edit);

/// What a part of a body sends to a part beside it: which of its particles and, for each, the word of that
/// part's exchange, or resident_none if no block there reads it.
struct ResidentSending {
    std::vector<std::uint32_t> particles, words;
};
/// Empty, or why lanes cannot send to all of these neighbours.
std::string sent_refusal(const std::vector<ResidentSending>& neighbours);
/// Makes ResidentLinks::sent.
std::vector<std::uint32_t> sent_by_lanes(const ResidentLayout& layout,
                                         const std::vector<ResidentSending>& neighbours);
/// ResidentLayout::ghost_word of some of the ghosts of `problem`, whose layout is `layout`.
std::vector<std::uint32_t> words_of_ghosts(const ResidentLayout& layout, const Problem& problem,
                                           const std::vector<std::uint32_t>& ghosts);

/// Empty, or why no layout of `problem` suits a card with `multiprocessors` multiprocessors.
/// `launches_together`: the device can run all blocks of a launch at once.
std::string resident_refusal(const Problem& problem, int multiprocessors, bool launches_together);

/// Empty, or which limit of the kernel or of the card the layout exceeds.
std::string block_refusal(const ResidentLayout& layout, const ResidentCard& card,
                          ToolMode tool = ToolMode::none);

/// The predicted time of a step in which threads have several particles. `hertz`: clock of the
/// multiprocessors.
double seconds_in_turns(const ResidentLayout& layout, double hertz);
/// Empty, or how much faster bricks are predicted to step the same body. Also empty if every thread has one
/// particle: such layouts have been measured against bricks, and the rules of `auto` rank them already.
/// `bricks`: the plan of bricks for the body, if there is one.
std::string outpaced_by_bricks(const ResidentLayout& layout, const std::optional<BrickPlan>& bricks,
                               double hertz);

/// Per lane: the index of its particle in `held`, which is ascending; resident_none: it is not held.
std::vector<std::uint32_t> held_by_lanes(const ResidentLayout& layout,
                                         const std::vector<std::uint32_t>& held);

}  // namespace voxspring::layout
