// Macros:
// - SHAPE: a BrickShape.
// - EQUAL_EDGES: true if equal_edges() holds.
// - POLLERS: the number of additional threads, which have no tile. Each waits for at most ROUNDS points that
//   other blocks send.
// - POLLERS_SEND: 1 if pollers send the points of their block, at most SENT_ROUNDS each, after each step. 0:
// they
//   do so before the first step only, and threads with tiles send their particles while they step them.
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
    __device__ std::uint32_t moves(int n) const { return bit(Tile::moves_bit + n); }
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
    /// Where the half of BrickStep::exchange begins through which blocks send the points of now() or next().
    __device__ std::size_t exchange(const BrickStep& step) const { return now_ == 0 ? 0 : step.axis; }
    __device__ std::size_t next_exchange(const BrickStep& step) const { return next_ == 0 ? 0 : step.axis; }
    __device__ void swap() {
        const int now = now_;
        now_ = next_;
        next_ = now;
    }

private:
    int now_ = 0, next_ = shape.half();
};

/// Points that a poller sends or receives. `rounds`: how many there are at most; `turn`: how many the poller
/// has at once.
template <int rounds, int turn>
struct PointsOfPoller {
    BrickPoint point[turn];

    /// Loads the points from number `first` on. `of`: BrickStep::sent or BrickStep::received. Loads past L1,
    /// so that L1 keeps the masks.
    __device__ void load(const BrickPoint* of, int poller, int first) {
#pragma unroll
        for (int n = 0; n < turn; ++n) {
            const std::uint32_t round = std::uint32_t(first + n);
            point[n] = {resident_none, 0};
            if (round >= rounds) continue;
            const BrickPoint* const from = of + blockIdx.x * (rounds * POLLERS) + poller + round * POLLERS;
            asm volatile("ld.global.nc.L1::no_allocate.v2.u32 {%0, %1}, [%2];"
                         : "=r"(point[n].element), "=r"(point[n].slot)
                         : "l"(from));
        }
    }
    /// Calls visit() for one turn after the other.
    template <class Visit>
    __device__ void in_turns(const BrickPoint* of, int poller, Visit visit) {
        ROLLED
        for (int first = 0; first < rounds; first += turn) {
            // Load the next turn's points meanwhile.
            PointsOfPoller next = *this;
            if constexpr (rounds > turn) next.load(of, poller, first + turn < rounds ? first + turn : 0);
            visit();
            *this = next;
        }
    }
};

VOXSPRING_HOST_DEVICE constexpr int turn_of(int rounds, int most) {
    return rounds <= most ? rounds : polls_in_turn;
}
using ReceivedPoints = PointsOfPoller<ROUNDS, turn_of(ROUNDS, kept_polls - 1)>;
using SentPoints = PointsOfPoller<SENT_ROUNDS, turn_of(SENT_ROUNDS, polls_in_turn)>;

/// Sends points of `from`, a half of `points`, to other blocks.
__device__ void send(const SentPoints& sent, const float* from, TaggedPoint* exchange, std::uint32_t tag) {
#pragma unroll
    for (const BrickPoint& point : sent.point)
        publish_if(point.element != resident_none, exchange + point.element,
                   Tile::load(from, int(point.slot)), tag);
}
/// Waits for the points that other blocks send with `tag`, and stores them to `to`, a half of `points`.
/// Returns false if not all of them came; the launch must then end. `number`: the step whose points they are.
__device__ bool receive(const ReceivedPoints& received, const BrickStep& step, std::uint32_t number,
                        float* to, const TaggedPoint* exchange, std::uint32_t tag) {
    std::uint32_t missing = 0;
    constexpr int count = sizeof received.point / sizeof(BrickPoint);
#pragma unroll
    for (int n = 0; n < count; ++n) {
        if (received.point[n].element != resident_none) missing |= 1U << n;
    }
    return wait_for_words<count, false>(
        step.wait, number, missing, tag,
        [&](int n) { return load_word_gpu(exchange + received.point[n].element); },
        [&](int n, Vector<float> point) { Tile::store(to, int(received.point[n].slot), point); });
}

/// Takes `count` steps of a thread's tile. `idle`: the thread has no tile, or its warp has no particles.
/// `tag`: of the points from which the first step starts.
template <class Words>
__device__ void run_steps(const BrickStep& step, const BrickBlock& block, Tile& tile, Words& words, bool idle,
                          int thread, int count, std::uint32_t tag) {
    DoubleBuffer buffers;
    tile.start(points);
#if !POLLERS_SEND
    TaggedPoint* const first = step.exchange + tile.element(step, 0, 0, 0);
    const std::uint32_t border = idle ? 0 : tile.border(block, words);
#endif
    ROLLED
    for (int n = 1; n <= count; ++n) {
        if constexpr (!keeps_masks && !Words::by_side) words.load(step, lane_of(thread));
        if (!idle) tile.add_early(step, buffers.now(), words);
        border_is_here();
        if (!idle) {
            tile.add_late(step, buffers.now(), words);
#if !POLLERS_SEND
            TaggedPoint* const to = first + buffers.next_exchange(step);
#endif
            tile.integrate(step, buffers.next(), words, [&](int m, int i, int j, int k, Vector<float> point) {
#if !POLLERS_SEND
                publish_if((border & 1U << m) != 0, to + tile.from_first(step, i, j, k), point,
                           tag + std::uint32_t(n));
#endif
            });
        }
        step_is_done();
        buffers.swap();
    }
}

/// The part of pollers: receives the points from which each of `count` steps starts, and sends the block's
/// points from which the first step starts and, with POLLERS_SEND, the others. `tag`: of the first points.
/// `number`: of the latest step before.
__device__ void exchange_points(const BrickStep& step, int poller, int count, std::uint32_t tag,
                                std::uint32_t number) {
    SentPoints sent;
    sent.load(step.sent, poller, 0);
    ReceivedPoints received;
    received.load(step.received, poller, 0);
    DoubleBuffer buffers;
    const auto send_points = [&] {
        sent.in_turns(step.sent, poller,
                      [&] { send(sent, buffers.now(), step.exchange + buffers.exchange(step), tag); });
    };
#if !POLLERS_SEND
    send_points();
#endif
    bool in_vain = false;  // true: a wait was in vain, and this thread waits no more
    ROLLED
    for (int n = 0; n < count; ++n, ++tag, ++number) {
#if POLLERS_SEND
        send_points();
#endif
        received.in_turns(step.received, poller, [&] {
            if (!in_vain)
                in_vain = !receive(received, step, number, buffers.now(),
                                   step.exchange + buffers.exchange(step), tag);
        });
        border_is_here();
        step_is_done();
        buffers.swap();
    }
}

/// Bit n: the lane's particle number n of `rows` exists.
__device__ std::uint32_t existing(const WarpRows<shape>& rows, const TileWords& words) {
    std::uint32_t bits = 0;
    Tile::visit_particles([&](int n, int i, int j, int k) {
        const std::uint32_t of_tiles = __ballot_sync(0xFFFFFFFFU, words.exists(n));
#pragma unroll
        for (int m = 0; m < shape.tx; ++m) {
            if (rows.i[m] == i) bits |= (of_tiles >> rows.lane[m] & 1U) << shape.number(m, j, k);
        }
    });
    return bits;
}

/// Writes the state after `count` steps, once all threads of the block have taken them.
__device__ void store_state(const BrickStep& step, const Tile& tile, const TileWords& words, float* current,
                            float* before, int count) {
    const float* const last = points + ((count & 1) != 0 ? shape.half() : 0);
    float* const previous = points + ((count & 1) != 0 ? 0 : shape.half());
    if constexpr (Terms::increments) {
        Tile::visit_particles([&](int n, int i, int j, int k) {
            if (words.exists(n)) Tile::store(previous, tile.slot(i, j, k), tile.increment(n));
        });
    }
    __syncwarp();
    // The thread's number is read anew, so that no register keeps it during the steps.
    int thread = 0;
    asm volatile("mov.u32 %0, %%tid.x;" : "=r"(thread));
    const WarpRows<shape> rows(step, step.blocks[blockIdx.x], thread);
    const std::uint32_t exists = existing(rows, words);
    rows.visit([&](int n, int slot, std::size_t element) {
        if ((exists >> n & 1U) == 0) return;
        store_axes(current + element, step.axis, Tile::load(last, slot));
        store_axes(before + element, step.axis, Tile::load(previous, slot));
    });
}

/// Takes `count` steps, at least one. `current` and `before` hold the state before the first step and then
/// the state after the last one, in structure of arrays: x or u at t, and x or u at t - dt or, by increments,
/// v. `tag` is the number of the latest step before this launch. `launches`: the number of launches since the
/// upload, this one included. Points have tags of `tag` + `launches` and more: the tag of a launch's first
/// points differs from that of the last points of the launch before, which may be of another state.
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
        Tile::visit_particles([&](int n, int i, int j, int k) {
            Vector<float> previous{0, 0, 0};
            if (words.exists(n)) {
                const int slot = tile.slot(i, j, k);
                const std::size_t element = tile.element(step, i, j, k);
                Tile::store(points, slot, load_axes(current + element, step.axis));
                previous = load_axes(before + element, step.axis);
                if (!Terms::increments) Tile::store(points + shape.half(), slot, previous);
            }
            if constexpr (Terms::increments) tile.set_increment(n, previous);
        });
        __syncthreads();
        const bool idle = __all_sync(0xFFFFFFFFU, words.none()) || !has_tile;
#if PLAIN_BLOCKS
        if (all_plain) {
            FullTileMasks plain(sides, words, Tile::particles);
            run_steps(step, block, tile, plain, idle, thread, count, tag + launches);
        } else
#endif
            run_steps(step, block, tile, words, idle, thread, count, tag + launches);
        if constexpr (!keeps_masks) words.load(step, lane_of(thread));
        store_state(step, tile, words, current, before, count);
    } else {
#if LANE_REGISTERS > 0
        asm volatile("setmaxnreg.dec.sync.aligned.u32 %0;" ::"n"(POLLER_REGISTERS));
#endif
        __syncthreads();
        exchange_points(step, thread - lanes, count, tag + launches, tag);
    }
}

}  // namespace voxspring::cuda
