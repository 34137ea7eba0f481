// LANES threads of a block have a particle each. POLLERS more wait for ROUNDS points of other blocks each.
// SLOTS: how many points shared memory holds. BORDERS: the kinds of border in use, as bits. MASKED: 1 where
// the lattice is stressed at rest, so that the spring to an absent neighbour would pull.
#include "cuda/kernels/entry.h"
#include "cuda/kernels/resident.h"
#include "cuda/kernels/wait.h"

namespace voxspring::cuda {

static_assert(!Terms::split && sizeof(Real) == sizeof(float), "a tagged point has room for three floats");

constexpr int all_threads = LANES + POLLERS;
constexpr bool overlaps = BORDERS != 1 << mixed_border;

/// A step reads one half and writes the other.
__shared__ float points[2][3][SLOTS];

__device__ void put(int half, int slot, Vector<float> point) {
    points[half][0][slot] = point.x;
    points[half][1][slot] = point.y;
    points[half][2][slot] = point.z;
}

/// These are the hardware's barriers 1 and 2. __syncthreads() uses 0.
__device__ void border_is_here() { asm volatile("bar.sync 1, %0;" ::"n"(all_threads) : "memory"); }
__device__ void own_points_are_here() { asm volatile("bar.sync 2, %0;" ::"n"(LANES) : "memory"); }

struct Lane {
    Self<float, false> self;
    PreviousOrVelocity<float> before;
    bool active;  ///< there is a particle
    int word;
    int own_slot;
    int slot[neighbour_bits];
    Vector<float> spacing;   ///< of the lattice, negative along axes in which the warp is mirrored
    TaggedPoint* published;  ///< null where no other block reaches the particle
};

/// Fetches neighbours from shared memory. Only the slots of groups that are compiled in are used.
struct SlotNeighbours {
    const Lane& lane;
    int half;
    __device__ Point<float, false> operator()(int dx, int dy, int dz) const {
        const int slot = lane.slot[bit_of(dx, dy, dz)];
        return {{points[half][0][slot], points[half][1][slot], points[half][2][slot]}};
    }
};
struct NoCompliance {
    __device__ float operator()(int, int, int) const { return 0; }
};

/// Takes a step that reads half `half`. Springs across the border are added last, once its points have come.
template <class Border, int half>
__device__ void step_lane(const ResidentStep& step, Lane& lane, std::uint32_t tag, bool first, bool last) {
    constexpr bool full_stencil = MASKED == 0;
    GroupSums<float> sums;
    const SlotNeighbours neighbours{lane, half};
    add_springs<Terms, full_stencil, Except<Border>, float>(step, lane.spacing, lane.self, neighbours,
                                                            NoCompliance{}, sums);
    if (!first) border_is_here();
    add_springs<Terms, full_stencil, Border, float>(step, lane.spacing, lane.self, neighbours, NoCompliance{},
                                                    sums);
    const Integrated<float, false> next =
        integrate<Terms>(step.motion, lane.word, lane.self, lane.before, force_of<Terms, float>(step, sums));
    lane.self.point = next.point;
    lane.before = next.before;
    // A branch: without one the kernel of increments with 80 registers waits longer.
    if (lane.published != nullptr && !last)
        publish_if(true, lane.published + (1 - half) * step.published_count, next.point.high, tag + 1);
    put(1 - half, lane.own_slot, next.point.high);
    if constexpr (overlaps) own_points_are_here();
}

template <class Border>
__device__ void run_lane(const ResidentStep& step, Lane& lane, int count, std::uint32_t tag) {
    for (int n = 0; n < count; n += 2) {
        step_lane<Border, 0>(step, lane, tag + n, n == 0, n + 1 == count);
        if (n + 1 < count) step_lane<Border, 1>(step, lane, tag + n + 1, false, n + 2 == count);
    }
}

template <int kind>
__device__ void run_lane_of(int border, const ResidentStep& step, Lane& lane, int count, std::uint32_t tag) {
    if constexpr ((BORDERS >> kind & 1) != 0) {
        if (border == kind) {
            if constexpr (kind == mixed_border) {
                run_lane<EveryNeighbour>(step, lane, count, tag);
            } else {
                run_lane<Across<kind / 2 != 0, kind % 2 != 0>>(step, lane, count, tag);
            }
            return;
        }
    }
    if constexpr (kind + 1 < border_kinds) run_lane_of<kind + 1>(border, step, lane, count, tag);
}

struct Polls {
    const TaggedPoint* from[ROUNDS];
    int slot[ROUNDS];
    std::uint32_t wanted;  ///< bits
};

/// Fetches into half `half` the points that other blocks publish with `tag`.
__device__ void poll(const Polls& polls, const ResidentStep& step, int half, std::uint32_t tag) {
    std::uint32_t missing = polls.wanted;
    std::uint32_t polls_in_vain = 0;
    while (missing != 0) {
        TaggedPoint found[ROUNDS];
#pragma unroll
        for (int n = 0; n < ROUNDS; ++n) found[n] = look_up(polls.from[n] + half * step.published_count);
#pragma unroll
        for (int n = 0; n < ROUNDS; ++n) {
            if ((missing >> n & 1) == 0 || found[n].tag != tag) continue;
            put(half, polls.slot[n], found[n].point);
            missing &= ~(1U << n);
        }
        if (missing != 0 && ++polls_in_vain == max_resident_polls) give_up(step.stall, tag);
    }
}

/// Takes `count` steps, at least one, of the state in `words` and `previous` or, by increments, `increment`,
/// whose axes are `pitch` elements apart; the state after the last step replaces it. Points are published
/// with the tags `tag` + 1, `tag` + 2 and so on. `launches`: how many launches have counted their blocks in
/// `step.started_blocks`, this one included.
extern "C" __global__ void __launch_bounds__(all_threads, 1)
    step(const __grid_constant__ ResidentStep step, ParticleRecord<float>* words,
         ParticleRecord<float>* previous, float* increment, std::size_t pitch, int count, std::uint32_t tag,
         std::uint32_t launches) {
    const int thread = int(threadIdx.x);
    if (thread < LANES) {
        const std::uint32_t at = blockIdx.x * LANES + std::uint32_t(thread);
        Lane lane{};
        const std::uint32_t word = step.particle[at];
        lane.active = word != resident_none;
        lane.word = lane.active ? int(word) : 0;
        lane.own_slot = step.own_slot[at];
        const std::uint32_t published = step.published[at];
        lane.published = published == resident_none ? nullptr : step.exchange + published;
#pragma unroll
        for (int bit = 0; bit < neighbour_bits; ++bit) {
            if ((Terms::groups >> bit & 1) != 0) lane.slot[bit] = step.slot[bit * step.lane_count + at];
        }
        if (lane.active) {
            const Particle<float> start = load_past_l1(words + lane.word);
            lane.self = {{start.position}, start.bits};
            if constexpr (Terms::increments) {
                lane.before.high = load_axes(increment + lane.word, pitch);
            } else {
                lane.before.high = load_past_l1(previous + lane.word).position;
            }
        }
        put(0, lane.own_slot, lane.self.point.high);
        __syncthreads();
        const int border = step.border[at / 32];
        lane.spacing = step.spacing;
        if ((border & mirrored_y) != 0) lane.spacing.y = -lane.spacing.y;
        if ((border & mirrored_z) != 0) lane.spacing.z = -lane.spacing.z;
        run_lane_of<0>(border & border_kind_bits, step, lane, count, tag);
        if (!lane.active) return;
        wait_until_all_have_started(step.started_blocks, launches * gridDim.x, step.stall, tag + count);
        store(words + lane.word, Particle<float>{lane.self.point.high, lane.self.bits});
        if constexpr (Terms::increments) {
            store_axes(increment + lane.word, pitch, lane.before.high);
        } else {
            store(previous + lane.word, Particle<float>{lane.before.high, lane.self.bits});
        }
    } else {
        const std::uint32_t at = blockIdx.x * POLLERS + std::uint32_t(thread - LANES);
        Polls polls{};
#pragma unroll
        for (int n = 0; n < ROUNDS; ++n) {
            const std::uint32_t poll = std::uint32_t(n) * gridDim.x * POLLERS + at;
            const std::uint32_t from = step.polled[poll];
            polls.from[n] = step.exchange + (from == resident_none ? 0 : from);
            polls.slot[n] = step.polled_slot[poll];
            if (from == resident_none) continue;
            polls.wanted |= 1U << n;
            put(0, polls.slot[n], load_past_l1(words + step.polled_word[poll]).position);
        }
        __syncthreads();
        if (thread == LANES)
            asm volatile("red.release.gpu.global.add.u32 [%0], 1;" ::"l"(step.started_blocks) : "memory");
        for (int n = 1; n < count; n += 2) {
            poll(polls, step, 1, tag + n);
            border_is_here();
            if (n + 1 == count) break;
            poll(polls, step, 0, tag + n + 1);
            border_is_here();
        }
    }
}

}  // namespace voxspring::cuda
