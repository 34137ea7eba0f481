// What the threads of a block of the resident kernel do (resident.cu). Device code, which a host runs as well
// that brings the built-in names and barriers of a device (tests/host_blocks.h).
#pragma once

#include "cuda/kernels/resident.h"
#include "cuda/kernels/wait.h"

namespace voxspring::cuda {

/// What a resident kernel is compiled for.
struct ResidentShape {
    int lanes;              ///< threads of a block that have a particle each
    int pollers;            ///< threads beside those, which wait for points of other blocks
    int rounds;             ///< points that each of them waits for
    int slots;              ///< points in shared memory
    std::uint32_t borders;  ///< kinds of border in use, as bits
    bool masked;  ///< the lattice is stressed at rest, so that the spring to an absent neighbour would pull
};

struct NoCompliance {
    __device__ float operator()(int, int, int) const { return 0; }
};

/// One thread's view of its block.
template <class Terms, ResidentShape shape>
class ResidentBlock {
public:
    static constexpr int all_threads = shape.lanes + shape.pollers;

    /// In shared memory. A step reads one half of the points and writes the other.
    struct Shared {
        float points[2][3][shape.slots];
    };

    /// Where the state lies.
    struct Memory {
        ParticleRecord<float>* words;
        ParticleRecord<float>* previous;
        float* increment;
        std::size_t pitch;
    };

    __device__ ResidentBlock(Shared& shared, const ResidentStep& step) : shared_(shared), step_(step) {}

    /// Takes `count` steps, at least one. resident.cu says what the arguments are.
    __device__ void run(const Memory& memory, int count, std::uint32_t tag, std::uint32_t launches) {
        const int thread = int(threadIdx.x);
        if (thread < shape.lanes) {
            const std::uint32_t at = blockIdx.x * shape.lanes + std::uint32_t(thread);
            Lane lane{};
            load(lane, at, memory);
            put(0, lane.own_slot, lane.self.point.high);
            __syncthreads();
            const int border = step_.border[at / 32];
            lane.spacing = step_.spacing;
            if ((border & mirrored_y) != 0) lane.spacing.y = -lane.spacing.y;
            if ((border & mirrored_z) != 0) lane.spacing.z = -lane.spacing.z;
            run_lane_of<0>(border & border_kind_bits, lane, count, tag);
            if (!lane.active) return;
            wait_until_counted(step_.started_blocks, launches * gridDim.x, step_.stall, tag + count);
            store(lane, memory);
        } else {
            const std::uint32_t at = blockIdx.x * shape.pollers + std::uint32_t(thread - shape.lanes);
            Polls polls{};
            load(polls, at, memory);
            __syncthreads();
            if (thread == shape.lanes) count_block(step_.started_blocks);
            run_poller(polls, count, tag);
        }
    }

private:
    static_assert(!Terms::split, "a tagged point has room for three floats");
    static constexpr bool overlaps = shape.borders != 1U << mixed_border;

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
        const Shared& shared;
        const Lane& lane;
        int half;
        __device__ Point<float, false> operator()(int dx, int dy, int dz) const {
            const int slot = lane.slot[bit_of(dx, dy, dz)];
            return {
                {shared.points[half][0][slot], shared.points[half][1][slot], shared.points[half][2][slot]}};
        }
    };

    struct Polls {
        const TaggedPoint* from[shape.rounds];
        int slot[shape.rounds];
        std::uint32_t wanted;  ///< bits
    };

    // The hardware's barriers 1 and 2. __syncthreads() uses 0.
    static __device__ void border_is_here() { meet<1, all_threads>(); }
    static __device__ void own_points_are_here() { meet<2, shape.lanes>(); }

    __device__ void put(int half, int slot, Vector<float> point) {
        shared_.points[half][0][slot] = point.x;
        shared_.points[half][1][slot] = point.y;
        shared_.points[half][2][slot] = point.z;
    }

    __device__ void load(Lane& lane, std::uint32_t at, const Memory& memory) const {
        const std::uint32_t word = step_.particle[at];
        lane.active = word != resident_none;
        lane.word = lane.active ? int(word) : 0;
        lane.own_slot = step_.own_slot[at];
        const std::uint32_t published = step_.published[at];
        lane.published = published == resident_none ? nullptr : step_.exchange + published;
#pragma unroll
        for (int bit = 0; bit < neighbour_bits; ++bit) {
            if ((Terms::groups >> bit & 1) != 0) lane.slot[bit] = step_.slot[bit * step_.lane_count + at];
        }
        if (!lane.active) return;
        const Particle<float> start = load_past_l1(memory.words + lane.word);
        lane.self = {{start.position}, start.bits};
        if constexpr (Terms::increments) {
            lane.before.high = load_axes(memory.increment + lane.word, memory.pitch);
        } else {
            lane.before.high = load_past_l1(memory.previous + lane.word).position;
        }
    }

    __device__ void store(const Lane& lane, const Memory& memory) const {
        cuda::store(memory.words + lane.word, Particle<float>{lane.self.point.high, lane.self.bits});
        if constexpr (Terms::increments) {
            store_axes(memory.increment + lane.word, memory.pitch, lane.before.high);
        } else {
            cuda::store(memory.previous + lane.word, Particle<float>{lane.before.high, lane.self.bits});
        }
    }

    __device__ void load(Polls& polls, std::uint32_t at, const Memory& memory) {
#pragma unroll
        for (int n = 0; n < shape.rounds; ++n) {
            const std::uint32_t poll = std::uint32_t(n) * gridDim.x * shape.pollers + at;
            const std::uint32_t from = step_.polled[poll];
            polls.from[n] = step_.exchange + (from == resident_none ? 0 : from);
            polls.slot[n] = step_.polled_slot[poll];
            if (from == resident_none) continue;
            polls.wanted |= 1U << n;
            put(0, polls.slot[n], load_past_l1(memory.words + step_.polled_word[poll]).position);
        }
    }

    /// Takes a step that reads half `half`. Springs across the border are added last, once its points have
    /// come.
    template <class Border, int half>
    __device__ void step_lane(Lane& lane, std::uint32_t tag, bool first, bool last) {
        constexpr bool full_stencil = !shape.masked;
        GroupSums<float> sums;
        const SlotNeighbours neighbours{shared_, lane, half};
        add_springs<Terms, full_stencil, Except<Border>, float>(step_, lane.spacing, lane.self, neighbours,
                                                                NoCompliance{}, sums);
        if (!first) border_is_here();
        add_springs<Terms, full_stencil, Border, float>(step_, lane.spacing, lane.self, neighbours,
                                                        NoCompliance{}, sums);
        const Integrated<float, false> next = integrate<Terms>(
            step_.motion, lane.word, lane.self, lane.before, force_of<Terms, float>(step_, sums));
        lane.self.point = next.point;
        lane.before = next.before;
        // A branch: without one the kernel of increments with 80 registers waits longer.
        if (lane.published != nullptr && !last)
            publish_if(true, lane.published + (1 - half) * step_.published_count, next.point.high, tag + 1);
        put(1 - half, lane.own_slot, next.point.high);
        if constexpr (overlaps) own_points_are_here();
    }

    template <class Border>
    __device__ void run_lane(Lane& lane, int count, std::uint32_t tag) {
        for (int n = 0; n < count; n += 2) {
            step_lane<Border, 0>(lane, tag + n, n == 0, n + 1 == count);
            if (n + 1 < count) step_lane<Border, 1>(lane, tag + n + 1, false, n + 2 == count);
        }
    }

    template <int kind>
    __device__ void run_lane_of(int border, Lane& lane, int count, std::uint32_t tag) {
        if constexpr ((shape.borders >> kind & 1) != 0) {
            if (border == kind) {
                if constexpr (kind == mixed_border) {
                    run_lane<EveryNeighbour>(lane, count, tag);
                } else {
                    run_lane<Across<kind / 2 != 0, kind % 2 != 0>>(lane, count, tag);
                }
                return;
            }
        }
        if constexpr (kind + 1 < border_kinds) run_lane_of<kind + 1>(border, lane, count, tag);
    }

    __device__ void run_poller(const Polls& polls, int count, std::uint32_t tag) {
        for (int n = 1; n < count; n += 2) {
            poll(polls, 1, tag + n);
            border_is_here();
            if (n + 1 == count) break;
            poll(polls, 0, tag + n + 1);
            border_is_here();
        }
    }

    /// Fetches into half `half` the points that other blocks publish with `tag`.
    __device__ void poll(const Polls& polls, int half, std::uint32_t tag) {
        std::uint32_t missing = polls.wanted;
        std::uint32_t polls_in_vain = 0;
        while (missing != 0) {
            TaggedPoint found[shape.rounds];
#pragma unroll
            for (int n = 0; n < shape.rounds; ++n)
                found[n] = look_up(polls.from[n] + half * step_.published_count);
#pragma unroll
            for (int n = 0; n < shape.rounds; ++n) {
                if ((missing >> n & 1) == 0 || found[n].tag != tag) continue;
                put(half, polls.slot[n], found[n].point);
                missing &= ~(1U << n);
            }
            if (missing != 0 && ++polls_in_vain == max_resident_polls) give_up(step_.stall, tag);
        }
    }

    Shared& shared_;
    const ResidentStep& step_;
};

}  // namespace voxspring::cuda
