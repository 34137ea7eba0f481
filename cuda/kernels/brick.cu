// Macros:
// - SHAPE: a BrickShape.
// - EQUAL_EDGES: true if equal_edges() holds.
// - POLLERS: the number of additional threads, which have no tile. Each waits for the points of at most
//   ROUNDS particles that other blocks send.
// - LANE_REGISTERS, POLLER_REGISTERS: registers per thread that has a tile, and per poller, if pollers hand
//   registers to the other threads. Otherwise both are 0.
// - PLAIN_BLOCKS: 1 if blocks whose threads are all plain (TileSides) have separate code. That code tests
//   one bit for all springs across the same sides of a tile, and no bits of single springs.
// - INCREMENTS_IN_MEMORY: true if increments are not in registers.
#include "cuda/kernels/brick.h"
#include "cuda/kernels/entry.h"
#include "cuda/kernels/wait.h"

namespace voxspring::cuda {

inline constexpr BrickShape shape = SHAPE;
constexpr int lanes = shape.lanes();
constexpr int all_threads = lanes + POLLERS;
using Tile = BrickTile<Terms, shape, EQUAL_EDGES, INCREMENTS_IN_MEMORY>;
constexpr int mask_words = Tile::mask_words;
/// Whether a thread keeps its masks in registers. Masks of larger tiles are read anew in each step.
constexpr bool keeps_masks = mask_words <= 6;

extern __shared__ float points[];

// The hardware's barriers 1 and 2. __syncthreads() uses 0.
__device__ void border_is_here() { meet<1, all_threads>(); }
__device__ void step_is_done() { meet<2, all_threads>(); }

/// The complete masks of a thread, whether it is plain or not.
struct TileWords {
    static constexpr bool by_side = false;
    std::uint32_t word[mask_words];
    __device__ std::uint32_t bit(int number) const { return word[number / 32] & 1U << number % 32; }
    __device__ std::uint32_t spring(int number, std::uint32_t /*crossed*/) const { return bit(number); }
    __device__ bool moves(int n) const { return bit(Tile::moves_bit + n) != 0; }
    __device__ bool exists(int n) const { return bit(Tile::exists_bit + n) != 0; }
    __device__ void load(const BrickStep& step, std::uint32_t lane) {
#pragma unroll
        for (int n = 0; n < mask_words; ++n) word[n] = __ldg(step.masks + n * step.lane_count + lane);
    }
    __device__ bool none() const {
        std::uint32_t any = 0;
#pragma unroll
        for (int n = 0; n < mask_words; ++n) any |= word[n];
        return any == 0;
    }
};

__device__ std::uint32_t lane_of(int thread) { return blockIdx.x * lanes + std::uint32_t(thread); }

/// The half of the points that is read in a step, and the half that is written. swap() exchanges two offsets:
/// with a condition instead, the compiler would duplicate the loop over steps.
class DoubleBuffer {
public:
    __device__ float* now() const { return points + now_; }
    __device__ float* next() const { return points + next_; }
    /// Where the half of BrickStep::exchange begins to which this step's points are published.
    __device__ std::size_t exchange(const BrickStep& step) const { return next_ == 0 ? 0 : step.axis; }
    __device__ void swap() {
        const int now = now_;
        now_ = next_;
        next_ = now;
    }

private:
    int now_ = 0, next_ = shape.half();
};

/// Takes `count` steps of a thread's tile. `idle`: the thread has no tile, or its warp has no particles.
template <class Words>
__device__ void run_steps(const BrickStep& step, Tile& tile, Words& words, bool idle, int thread, int count,
                          std::uint32_t tag) {
    DoubleBuffer buffers;
    tile.start(points, words);
    TaggedPoint* const first = step.exchange + tile.element(step, 0, 0, 0);
    ROLLED
    for (int n = 1; n <= count; ++n) {
        if constexpr (!keeps_masks && !Words::by_side) words.load(step, lane_of(thread));
        if (!idle) tile.add_early(step, buffers.now(), words);
        border_is_here();
        if (!idle) {
            tile.add_late(step, buffers.now(), words);
            TaggedPoint* const to = first + buffers.exchange(step);
            tile.integrate(
                step, buffers.next(), words, [&](bool here, int i, int j, int k, Vector<float> point) {
                    publish_if(here, to + tile.from_first(step, i, j, k), point, tag + std::uint32_t(n));
                });
        }
        step_is_done();
        buffers.swap();
    }
}

/// How many points a poller looks up at the same time.
constexpr int polls_in_flight = ROUNDS < kept_polls ? ROUNDS : polls_in_turn;
/// Whether a poller keeps all its polls in registers. If not, it reads them anew in each step.
constexpr bool keeps_polls = ROUNDS == polls_in_flight;

/// Loads a poll past L1, so that L1 keeps the masks.
__device__ BrickPoll load_poll(const BrickPoll* from) {
    BrickPoll poll;
    asm("ld.global.nc.L1::no_allocate.v2.u32 {%0, %1}, [%2];" : "=r"(poll.from), "=r"(poll.slot) : "l"(from));
    return poll;
}

struct Polls {
    BrickPoll poll[polls_in_flight];
    /// Loads polls_in_flight polls of the poller with number `poller`, from its poll number `first` on.
    __device__ void load(const BrickStep& step, int poller, int first) {
#pragma unroll
        for (int n = 0; n < polls_in_flight; ++n) {
            const std::uint32_t round = std::uint32_t(first + n);
            poll[n] = {resident_none, 0};
            if (round < ROUNDS)
                poll[n] = load_poll(step.polls + (round * gridDim.x + blockIdx.x) * POLLERS + poller);
        }
    }
};

/// Fetches the points that other blocks publish with `tag` into `to`, a half of `points`. Returns false if
/// not all of them came; the launch must then end.
__device__ bool fetch_published(const Polls& polls, const BrickStep& step, float* to,
                                const TaggedPoint* exchange, std::uint32_t tag) {
    std::uint32_t missing = 0;
#pragma unroll
    for (int n = 0; n < polls_in_flight; ++n) {
        if (polls.poll[n].from != resident_none) missing |= 1U << n;
    }
    return wait_for_words<polls_in_flight, false>(
        step.wait, missing, tag, [&](int n) { return load_word_gpu(exchange + polls.poll[n].from); },
        [&](int n, Vector<float> point) { Tile::store(to, int(polls.poll[n].slot), point); });
}

/// Takes `count` steps, at least one. `current` and `before` hold the state before the first step and then
/// the state after the last one, in structure of arrays: x or u at t, and x or u at t - dt or, by increments,
/// v. Points are published with the tags `tag` + 1, `tag` + 2 and so on. `launches`: how many launches have
/// counted their blocks in `step.started_blocks`, this one included.
extern "C" __global__ void __launch_bounds__(all_threads, 1)
    step(const __grid_constant__ BrickStep step, float* current, float* before, int count, std::uint32_t tag,
         std::uint32_t launches) {
    const int thread = int(threadIdx.x);
    const BrickBlock block = step.blocks[blockIdx.x];
    for (int n = thread; n < shape.shared_words(); n += all_threads) points[n] = 0;
#if PLAIN_BLOCKS
    const TileSides sides{thread < shape.threads()
                              ? step.masks[mask_words * step.lane_count + lane_of(thread)]
                              : TileSides::plain};
    const bool all_plain = __syncthreads_and(sides.is_plain()) != 0;
#else
    __syncthreads();
#endif
    if (thread < lanes) {
#if LANE_REGISTERS > 0
        asm volatile("setmaxnreg.inc.sync.aligned.u32 %0;" ::"n"(LANE_REGISTERS));
#endif
        const bool has_tile = thread < shape.threads();
        Tile tile(step, block, has_tile ? thread : 0,
                  step.increments + std::size_t(blockIdx.x) * Tile::increment_words + thread);
        TileWords words;
        words.load(step, lane_of(thread));
        const auto element = [&](int i, int j, int k) { return tile.element(step, i, j, k); };
        Tile::visit_particles([&](int n, int i, int j, int k) {
            Vector<float> previous{0, 0, 0};
            if (words.exists(n)) {
                const int slot = tile.slot(i, j, k);
                Tile::store(points, slot, load_axes(current + element(i, j, k), step.axis));
                previous = load_axes(before + element(i, j, k), step.axis);
                if (!Terms::increments) Tile::store(points + shape.half(), slot, previous);
            }
            if constexpr (Terms::increments) tile.set_increment(n, previous);
        });
        __syncthreads();
        const bool idle = __all_sync(0xFFFFFFFFU, words.none()) || !has_tile;
#if PLAIN_BLOCKS
        if (all_plain) {
            FullTileMasks plain(sides, words, Tile::particles);
            run_steps(step, tile, plain, idle, thread, count, tag);
        } else
#endif
            run_steps(step, tile, words, idle, thread, count, tag);
        // The result does not matter: if this wait is in vain, the state is worthless, in memory as on the
        // chip.
        static_cast<void>(
            wait_until_counted(step.started_blocks, launches * gridDim.x, step.wait, tag + count));
        if constexpr (!keeps_masks) words.load(step, lane_of(thread));
        const float* const last = points + ((count & 1) != 0 ? shape.half() : 0);
        const float* const previous = points + ((count & 1) != 0 ? 0 : shape.half());
        Tile::visit_particles([&](int n, int i, int j, int k) {
            if (!words.exists(n)) return;
            const int slot = tile.slot(i, j, k);
            store_axes(current + element(i, j, k), step.axis, Tile::load(last, slot));
            if constexpr (Terms::increments) {
                store_axes(before + element(i, j, k), step.axis, tile.increment(n));
            } else {
                store_axes(before + element(i, j, k), step.axis, Tile::load(previous, slot));
            }
        });
    } else {
#if LANE_REGISTERS > 0
        asm volatile("setmaxnreg.dec.sync.aligned.u32 %0;" ::"n"(POLLER_REGISTERS));
#endif
        const int poller = thread - lanes;
        Polls polls;
        ROLLED
        for (int first = 0; first < ROUNDS; first += polls_in_flight) {
            polls.load(step, poller, first);
#pragma unroll
            for (int n = 0; n < polls_in_flight; ++n) {
                const BrickPoll& poll = polls.poll[n];
                if (poll.from != resident_none)
                    Tile::store(points, int(poll.slot), load_axes(current + poll.from, step.axis));
            }
        }
        __syncthreads();
        if (thread == lanes) count_block(step.started_blocks);
        DoubleBuffer buffers;
        if constexpr (!keeps_polls) polls.load(step, poller, 0);
        border_is_here();
        step_is_done();
        bool in_vain = false;  // true: a wait was in vain, and this thread waits no more
        ROLLED
        for (int n = 1; n < count; ++n) {
            // Poll only after this block's step is done: earlier polls would take instruction slots from it
            // and find little.
            ROLLED
            for (int first = 0; first < ROUNDS; first += polls_in_flight) {
                // Load the next turn's polls while the points of this turn travel.
                Polls next_polls = polls;
                if constexpr (!keeps_polls)
                    next_polls.load(step, poller,
                                    first + polls_in_flight < ROUNDS ? first + polls_in_flight : 0);
                if (!in_vain)
                    in_vain =
                        !fetch_published(polls, step, buffers.next(), step.exchange + buffers.exchange(step),
                                         tag + std::uint32_t(n));
                polls = next_polls;
            }
            border_is_here();
            buffers.swap();
            step_is_done();
        }
    }
}

}  // namespace voxspring::cuda
