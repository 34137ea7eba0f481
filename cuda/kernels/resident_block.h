// The work of the threads of a block of the resident kernel (resident.cu). This is device code. The host can
// run it too if the built-in names and barriers of a device are provided (tests/host_blocks.h).
#pragma once

#include "backends/layout/records/loops.h"
#include "cuda/kernels/resident.h"
#include "cuda/kernels/ticks.h"
#include "cuda/kernels/wait.h"

namespace voxspring::cuda {

/// What a resident kernel is compiled for.
struct ResidentShape {
    int lanes;              ///< threads of a block that have particles
    int pollers;            ///< threads without particles, which wait for points of other blocks
    int rounds;             ///< most points that a poller waits for
    int slots;              ///< points in each half of shared memory
    std::uint32_t borders;  ///< kinds of border in use, as bits
    /// Whether springs need masks: in place of an absent neighbour a particle has a spring to itself. Only if
    /// the lattice is stressed at rest does such a spring pull.
    bool masked;
    ToolMode tool;
    /// The kernel steps a part of a body and exchanges the points at its borders with the kernels that step
    /// the parts beside it.
    bool part = false;
    /// Particles per thread. If there are several, the thread steps one after the other and keeps none in
    /// registers. Then x(t - dt) is in the other half of the points in shared memory, and v is in global
    /// memory.
    int turns = 1;
};

struct NoCompliance {
    __device__ float operator()(int, int, int) const { return 0; }
};

/// The terms for integrate(): `Terms`, but without loads if the force already includes them.
template <class Terms, bool loads_in_force>
struct TermsOfMotion {
    using type = Terms;
};
template <Formulation f, std::uint32_t groups, std::uint32_t terms, bool at_run_time>
struct TermsOfMotion<KernelTerms<f, groups, terms, at_run_time>, true> {
    using type = KernelTerms<f, groups, terms & ~term_loads, at_run_time>;
};

/// One thread's view of its block.
template <class Terms, ResidentShape shape>
class ResidentBlock {
public:
    static constexpr int all_threads = shape.lanes + shape.pollers;

    static constexpr bool has_tool = shape.tool != ToolMode::none;
    static constexpr bool in_ticks = shape.tool == ToolMode::ticks;
    using StepOfWhole = std::conditional_t<has_tool, HeldResidentStep, ResidentStep>;
    using Step = std::conditional_t<shape.part, PartStep<StepOfWhole>, StepOfWhole>;

    /// Points in shared memory. A step reads one half of them and writes the other.
    struct Points {
        float points[2][3][shape.slots];
    };
    struct PointsAndOrder : Points {
        TickOrder order;  ///< what the host ordered for the current tick
    };
    using Shared = std::conditional_t<in_ticks, PointsAndOrder, Points>;

    struct Memory {
        ParticleRecord<float>* words;
        ParticleRecord<float>* previous;
        float* increment;
        std::size_t pitch;
    };

    __device__ ResidentBlock(Shared& shared, const Step& step) : shared_(shared), step_(step) {}

    /// Takes `count` steps, at least one. In ToolMode::ticks it takes the steps that the host orders instead,
    /// until the host orders the end. step() in resident.cu describes the arguments.
    __device__ void run(const Memory& memory, int count, std::uint32_t tag, std::uint32_t launches) {
        const int thread = int(threadIdx.x);
        if (shape.turns > 1 && thread < shape.lanes) {
            run_in_turns(memory, count, tag, launches);
        } else if (thread < shape.lanes) {
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
            // The result does not matter: if this wait is in vain, the state is worthless, in memory as on
            // the chip.
            static_cast<void>(
                wait_until_counted(step_.started_blocks, launches * gridDim.x, step_.wait, tag + count));
            store(lane, memory);
        } else {
            const std::uint32_t at = blockIdx.x * shape.pollers + std::uint32_t(thread - shape.lanes);
            Polls polls{};
            load(polls, at, memory);
            __syncthreads();
            if (thread == shape.lanes) count_block(step_.started_blocks);
            run_poller(polls, count, tag);
            if constexpr (shape.part) keep_ghosts(polls, at, memory, launches, tag + count);
        }
    }

private:
    static_assert(!Terms::split, "a tagged point has no room for the low parts of `compensated`");
    static_assert(!shape.part || !in_ticks, "parts do not hear the host at the same step");
    using MotionTerms = typename TermsOfMotion<Terms, has_tool>::type;
    static constexpr bool overlaps = shape.borders != 1U << mixed_border;

    struct Lane {
        Self<float, false> self;
        PreviousOrVelocity<float> before;
        bool active;  ///< whether the lane has a particle
        int word;
        int own_slot;
        int newest;  ///< with several particles per thread: the half that the latest step wrote
        int slot[neighbour_bits];
        Vector<float> spacing;   ///< of the lattice, negative along axes in which the warp is mirrored
        TaggedPoint* published;  ///< null if no other block reads the particle
        std::uint32_t sent;      ///< the lane's entry in ResidentLinks::sent
        // Only used if there is a tool:
        std::uint32_t held;  ///< the lane's element of HeldResidentStep::held_by_lane
        Vector<float> load;  ///< without the tool's force
    };

    /// Fetches neighbours from shared memory. `lane.slot` is set for the spring groups that are compiled in.
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
        std::uint32_t wanted;  ///< bit n: point n has to be fetched
    };

    // The hardware's barriers 1 and 2. __syncthreads() uses 0.
    static __device__ void border_is_here() { meet<1, all_threads>(); }
    static __device__ void own_points_are_here() { meet<2, shape.lanes>(); }

    __device__ void put(int half, int slot, Vector<float> point) {
        shared_.points[half][0][slot] = point.x;
        shared_.points[half][1][slot] = point.y;
        shared_.points[half][2][slot] = point.z;
    }

    __device__ Vector<float> get(int half, int slot) const {
        return {shared_.points[half][0][slot], shared_.points[half][1][slot], shared_.points[half][2][slot]};
    }

    // --- Several particles per thread ---

    static __device__ std::uint32_t lane_of(int turn) {
        return (blockIdx.x * std::uint32_t(shape.turns) + std::uint32_t(turn)) * std::uint32_t(shape.lanes) +
               threadIdx.x;
    }

    __device__ void run_in_turns(const Memory& memory, int count, std::uint32_t tag, std::uint32_t launches) {
        ROLLED
        for (int turn = 0; turn < shape.turns; ++turn) {
            const std::uint32_t word = step_.particle[lane_of(turn)];
            if (word == resident_none) continue;
            const int slot = step_.own_slot[lane_of(turn)] % pinned_slot;
            put(0, slot, load_past_l1(memory.words + word).position);
            if constexpr (!Terms::increments) put(1, slot, load_past_l1(memory.previous + word).position);
        }
        __syncthreads();
        Lane lane{};
        memory_ = &memory;
        run_lane<EveryNeighbour>(lane, count, tag);
        static_cast<void>(
            wait_until_counted(step_.started_blocks, launches * gridDim.x, step_.wait, tag + count));
        ROLLED
        for (int turn = 0; turn < shape.turns; ++turn) {
            const std::uint32_t word = step_.particle[lane_of(turn)];
            if (word == resident_none) continue;
            const int slot = step_.own_slot[lane_of(turn)] % pinned_slot;
            const std::uint32_t bits = load_past_l1(memory.words + word).bits;
            cuda::store(memory.words + word, Particle<float>{get(lane.newest, slot), bits});
            if constexpr (!Terms::increments)
                cuda::store(memory.previous + word, Particle<float>{get(1 - lane.newest, slot), bits});
        }
    }

    /// Reads into `lane` what a step of the particle of lane number `at` needs.
    template <int half>
    __device__ void load_turn(Lane& lane, std::uint32_t at) const {
        const std::uint32_t word = step_.particle[at];
        lane.active = word != resident_none;
        if (!lane.active) return;
        lane.word = int(word);
        const std::uint16_t own = step_.own_slot[at];
        lane.own_slot = own % pinned_slot;
        lane.self = {{get(half, lane.own_slot)}, ACTIVE_BIT | ((own & pinned_slot) != 0 ? PINNED_BIT : 0)};
        if constexpr (shape.masked) lane.self.bits = load_past_l1(memory_->words + word).bits;
        if constexpr (Terms::increments) {
            lane.before.high = load_axes(memory_->increment + word, memory_->pitch);
        } else {
            lane.before.high = get(1 - half, lane.own_slot);
        }
        const std::uint32_t published = step_.published[at];
        lane.published = published == resident_none ? nullptr : step_.exchange + published;
        if constexpr (shape.part) lane.sent = step_.links.sent[at];
        const auto* const together = reinterpret_cast<const SlotsTogether*>(step_.slot);
        UNROLLED
        for (int first = 0; first < neighbour_bits; first += slots_together) {
            constexpr std::uint32_t several = (1U << slots_together) - 1;
            if ((Terms::groups >> first & several) == 0) continue;
            const SlotsTogether slots = together[std::size_t(first / slots_together) * step_.lane_count + at];
            UNROLLED
            for (int n = 0; n < slots_together && first + n < neighbour_bits; ++n)
                lane.slot[first + n] = slots.of[n];
        }
        lane.spacing = step_.spacing;
        if constexpr (has_tool) {
            lane.held = step_.held_by_lane[at];
            lane.load = step_.motion.load[lane.word];
        }
    }

    /// Takes a step of every particle of this thread. Particles with neighbours in other blocks come last,
    /// once those neighbours' points have arrived. So all springs of a particle are added in the order of the
    /// implicit kernels.
    template <int half>
    __device__ void step_in_turns(std::uint32_t tag, bool first, bool last) {
        // Read the tool's place now: after the wait for the border, the next tick's order may have replaced
        // this tick's.
        const ToolNow tool = tool_now();
        bool waits = !first;
        ROLLED
        for (int turn = 0; turn < shape.turns; ++turn) {
            const std::uint32_t at = lane_of(turn);
            Lane lane{};
            load_turn<half>(lane, at);
            if (waits && step_.border[at / 32] != 0) {
                border_is_here();
                waits = false;
            }
            if (!lane.active) continue;
            Vector<float> load{};
            if constexpr (has_tool) load = load_of(lane, last, [&] { return tool; });
            GroupSums<float> sums;
            add_springs<Terms, !shape.masked, EveryNeighbour, float>(
                step_, lane.spacing, lane.self, SlotNeighbours{shared_, lane, half}, NoCompliance{}, sums);
            finish<half>(lane, sums, load, tag, last);
            if constexpr (Terms::increments)
                store_axes(memory_->increment + lane.word, memory_->pitch, lane.before.high);
        }
        if (waits) border_is_here();
        if constexpr (overlaps) own_points_are_here();
    }

    // --- One particle per thread ---

    __device__ void load(Lane& lane, std::uint32_t at, const Memory& memory) const {
        const std::uint32_t word = step_.particle[at];
        lane.active = word != resident_none;
        lane.word = lane.active ? int(word) : 0;
        lane.own_slot = step_.own_slot[at];
        const std::uint32_t published = step_.published[at];
        lane.published = published == resident_none ? nullptr : step_.exchange + published;
        if constexpr (shape.part) lane.sent = step_.links.sent[at];
        UNROLLED
        for (int bit = 0; bit < neighbour_bits; ++bit) {
            if ((Terms::groups >> bit & 1) != 0) lane.slot[bit] = step_.slot[bit * step_.lane_count + at];
        }
        if constexpr (has_tool) lane.held = step_.held_by_lane[at];
        if (!lane.active) return;
        if constexpr (has_tool) lane.load = step_.motion.load[lane.word];
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
        UNROLLED
        for (int n = 0; n < shape.rounds; ++n) {
            const std::uint32_t poll = std::uint32_t(n) * gridDim.x * shape.pollers + at;
            const std::uint32_t from = step_.polled[poll];
            polls.from[n] = step_.exchange + (from == resident_none ? 0 : from);
            polls.slot[n] = step_.polled_slot[poll];
            if (from == resident_none) continue;
            polls.wanted |= 1U << n;
            put(0, polls.slot[n], load_past_l1(memory.words + word_of(poll)).position);
        }
    }

    __device__ std::uint32_t word_of(std::uint32_t poll) const {
        if constexpr (shape.part) return step_.polled_word[poll] & resident_word_bits;
        return step_.polled_word[poll];
    }

    /// Where the tool is, and the number of the tick.
    struct ToolNow {
        Vector<float> moved;
        std::uint32_t tick;
    };
    __device__ ToolNow tool_now() const {
        if constexpr (in_ticks) {
            return {shared_.order.moved, shared_.order.tick};
        } else if constexpr (has_tool) {
            return {step_.tool.moved, 0};
        } else {
            return {};
        }
    }

    /// The load of a lane's particle in a step, including the tool's force. now() returns a ToolNow. `last`:
    /// the step is the last one of a launch or tick, so the tool's force is stored for the host.
    template <class Now>
    __device__ Vector<float> load_of(const Lane& lane, bool last, Now now) const {
        if (lane.held == resident_none) return lane.load;
        const ToolNow tool = now();
        const Vector<float> force = hold_force(step_.held[lane.held].anchor, lane.self.point.high,
                                               Vector<float>{0, 0, 0}, tool.moved, step_.tool.stiffness);
        if (last) {
            if constexpr (in_ticks) {
                answer(force, tool.tick, step_.line.answers + lane.held);
            } else {
                step_.forces[lane.held] = {force};
            }
        }
        return lane.load + force;
    }

    /// Which half of the exchange holds the points with `tag`. `half`: the half of shared memory that holds
    /// the same step's points. Each launch begins with half 0 of shared memory. Without parts the exchange
    /// uses the same half. But a neighbouring part may be one launch ahead, and if that launch has a single
    /// step, its point must not replace the point before it, which may not have been read yet. So in parts
    /// the parity of the tag selects the half.
    ///
    /// Two halves are enough. A block sends the point of step n + 2 only once it, or its launch
    /// (keep_ghosts()), has the points of step n + 1 of all blocks that it reaches. These are the blocks that
    /// read its points, and each of them sends its point of step n + 1 only once all of its pollers have read
    /// step n.
    static __device__ int turn_of(int half, std::uint32_t tag) { return shape.part ? int(tag & 1) : half; }

    /// Takes a step that reads half `half` of shared memory. Springs across the block's border are added
    /// last, once the points of other blocks have arrived. The load is computed before that wait: after the
    /// wait, the next tick's order may have replaced this tick's.
    template <class Border, int half>
    __device__ void step_lane(Lane& lane, std::uint32_t tag, bool first, bool last) {
        if constexpr (shape.turns > 1) {
            lane.newest = 1 - half;
            return step_in_turns<half>(tag, first, last);
        }
        constexpr bool full_stencil = !shape.masked;
        Vector<float> load{};
        if constexpr (has_tool) load = load_of(lane, last, [&] { return tool_now(); });
        GroupSums<float> sums;
        const SlotNeighbours neighbours{shared_, lane, half};
        add_springs<Terms, full_stencil, Except<Border>, float>(step_, lane.spacing, lane.self, neighbours,
                                                                NoCompliance{}, sums);
        if (!first) border_is_here();
        add_springs<Terms, full_stencil, Border, float>(step_, lane.spacing, lane.self, neighbours,
                                                        NoCompliance{}, sums);
        finish<half>(lane, sums, load, tag, last);
        if constexpr (overlaps) own_points_are_here();
    }

    /// Moves a lane's particle by the forces of its springs (`sums`) and by `load`, and stores its new place
    /// for all threads, blocks and parts that read it.
    template <int half>
    __device__ void finish(Lane& lane, const GroupSums<float>& sums, Vector<float> load, std::uint32_t tag,
                           bool last) {
        Vector<float> force = force_of<Terms, float>(step_, sums);
        if constexpr (has_tool) force = force + load;
        const Integrated<float, false> next =
            integrate<MotionTerms>(step_.motion, lane.word, lane.self, lane.before, force);
        lane.self.point = next.point;
        lane.before = next.before;
        // This branch is faster than a predicated store. With such a store the kernel of formulation
        // `increment`, which has 80 registers per thread, waits longer.
        if (lane.published != nullptr && (in_ticks || !last))
            publish_if(true, lane.published + turn_of(1 - half, tag + 1) * step_.published_count,
                       next.point.high, tag + 1);
        if constexpr (shape.part) send(lane.sent, next.point.high, tag + 1);
        put(1 - half, lane.own_slot, next.point.high);
    }

    /// Sends a point to the neighbouring part that reads it, if there is one (`to`). This happens in the last
    /// step of a launch as well, since the neighbour's next launch begins with that point.
    __device__ void send(std::uint32_t to, Vector<float> point, std::uint32_t tag) const {
        if (to == resident_none) return;
        const ResidentNeighbour& neighbour = step_.links.neighbour[to / second_neighbour];
        store_word_system(neighbour.exchange + turn_of(0, tag) * neighbour.words + to % second_neighbour,
                          point, tag);
    }

    template <class Border>
    __device__ void run_lane(Lane& lane, int count, std::uint32_t tag) {
        if constexpr (in_ticks) return run_ticks<Border>(lane, tag);
        for (int n = 0; n < count; n += 2) {
            step_lane<Border, 0>(lane, tag + n, n == 0, n + 1 == count);
            if (n + 1 < count) step_lane<Border, 1>(lane, tag + n + 1, false, n + 2 == count);
        }
    }

    /// How far a thread has come with the host's orders. In each tick the host orders some steps
    /// (backends/layout/records/ticks.h).
    struct Turn {
        std::uint32_t next_tick;
        std::uint32_t steps;  ///< still to be taken in this tick
    };

    /// Whether there is another step to take. All threads of the block call this before each step; after the
    /// last step of a tick they wait for the next tick. The first poller waits for the order, since threads
    /// with particles are busy for longer. The new order replaces the previous one, which no thread reads any
    /// more: threads read an order only before their last wait for the border in its tick.
    __device__ bool goes_on(Turn& turn, std::uint32_t tag) {
        if (turn.steps == 0) {
            if (int(threadIdx.x) == shape.lanes)
                shared_.order = wait_for_order(step_.line, turn.next_tick, step_.wait, tag);
            __syncthreads();
            turn = {turn.next_tick + 1, shared_.order.steps};
            if (turn.steps == 0) return false;
        }
        --turn.steps;
        return true;
    }

    /// Takes the steps of all ticks. Only after a step is it known whether that step was the last. So every
    /// step publishes its points, and every step waits for the border, the first one of the launch included.
    template <class Border>
    __device__ void run_ticks(Lane& lane, std::uint32_t tag) {
        Turn turn{step_.line.first_tick, 0};
        while (true) {
            if (!goes_on(turn, tag)) return;
            step_lane<Border, 0>(lane, tag++, false, turn.steps == 0);
            if (!goes_on(turn, tag)) return;
            step_lane<Border, 1>(lane, tag++, false, turn.steps == 0);
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

    __device__ void run_poller(Polls& polls, int count, std::uint32_t tag) {
        if constexpr (in_ticks) return poll_ticks(polls, tag);
        for (int n = 1; n < count; n += 2) {
            poll(polls, 1, tag + n);
            border_is_here();
            if (n + 1 == count) break;
            poll(polls, 0, tag + n + 1);
            border_is_here();
        }
    }

    /// Fetches the points that the next step reads as soon as they are published, even if that step is one
    /// of the next tick (TickOrder).
    __device__ void poll_ticks(Polls& polls, std::uint32_t tag) {
        Turn turn{step_.line.first_tick, 0};
        for (int half = 1; goes_on(turn, tag); half = 1 - half) {
            border_is_here();
            poll(polls, half, ++tag);
        }
    }

    /// Fetches into half `half` the points that other blocks publish with `tag`. After a wait in vain this
    /// thread fetches no more points.
    __device__ void poll(Polls& polls, int half, std::uint32_t tag) {
        const bool found =
            wait_for_points(polls, polls.wanted, turn_of(half, tag), tag,
                            [&](int n, Vector<float> point) { put(half, polls.slot[n], point); });
        if (!found) polls.wanted = 0;
    }

    /// Calls found(n, point) for each of the polls `missing`, once its point is in half `turn` of the
    /// exchange. Returns false if not all of them came; the launch must then end.
    template <class Found>
    __device__ bool wait_for_points(const Polls& polls, std::uint32_t missing, int turn, std::uint32_t tag,
                                    Found found) {
        const auto load = [&](int n) {
            const TaggedPoint* const from = polls.from[n] + turn * step_.published_count;
            if constexpr (shape.part) {
                return load_word_system(from);
            } else {
                return load_word_gpu(from);
            }
        };
        return wait_for_words<shape.rounds, true>(step_.wait, tag, missing, tag, load, found);
    }

    /// Stores in memory, at the end of a launch, the ghosts that this thread keeps. (A ghost is a particle
    /// that another part steps.) Lanes store all other particles. A ghost is stored as x(t) and, unless by
    /// increments, as x(t - dt), since ghosts count as pinned. So the next launch, an edit and a check for
    /// divergence find ghosts like other particles.
    __device__ void keep_ghosts(const Polls& polls, std::uint32_t at, const Memory& memory,
                                std::uint32_t launches, std::uint32_t tag) {
        std::uint32_t kept = 0, word[shape.rounds];
        UNROLLED
        for (int n = 0; n < shape.rounds; ++n) {
            const std::uint32_t poll = std::uint32_t(n) * gridDim.x * shape.pollers + at;
            word[n] = step_.polled_word[poll];
            if ((word[n] & keeps_ghost) != 0) kept |= 1U << n;
            word[n] &= resident_word_bits;
        }
        if (kept == 0) return;
        static_cast<void>(wait_until_counted(step_.started_blocks, launches * gridDim.x, step_.wait, tag));
        wait_for_points(polls, kept, turn_of(0, tag), tag, [&](int n, Vector<float> point) {
            const Particle<float> ghost{point, load_past_l1(memory.words + word[n]).bits};
            cuda::store(memory.words + word[n], ghost);
            if constexpr (!Terms::increments) cuda::store(memory.previous + word[n], ghost);
        });
    }

    Shared& shared_;
    const Step& step_;
    const Memory* memory_ = nullptr;  ///< set only if a thread has several particles
};

}  // namespace voxspring::cuda
