// A brick of a lattice on the chip: threads own a tile of particles each and step it, using points that their
// block holds in shared memory. This is the body of the kernel (brick.cu), which adds the barriers. A test
// adds loops over threads instead.
#pragma once

#include "backends/layout/records/brick.h"
#include "cuda/kernels/exchange.h"
#include "cuda/kernels/march.h"

namespace voxspring::cuda {

/// A visitor that does nothing: visit_brick_springs() returns the mask bit after the last spring.
struct CountSprings {
    VOXSPRING_HOST_DEVICE constexpr void both(int, int, int, int, int, int, int) {}
    VOXSPRING_HOST_DEVICE constexpr void half(int, int, int, int, int, int, int) {}
};

/// Adds `change` to `point` if `moves` is not 0, by predicated instructions as in add_predicated().
VOXSPRING_HOST_DEVICE inline void move_predicated(Vector<float> change, std::uint32_t moves,
                                                  Vector<float>& point) {
#ifdef __CUDA_ARCH__
    asm("{\n"
        " .reg .pred moves;\n"
        " setp.ne.u32 moves, %6, 0;\n"
        " @moves add.rn.f32 %0, %0, %3;\n"
        " @moves add.rn.f32 %1, %1, %4;\n"
        " @moves add.rn.f32 %2, %2, %5;\n"
        "}"
        : "+f"(point.x), "+f"(point.y), "+f"(point.z)
        : "f"(change.x), "f"(change.y), "f"(change.z), "r"(moves));
#else
    if (moves != 0) point = point + change;
#endif
}

/// The meaning of each bit of a tile's masks.
template <BrickShape shape>
VOXSPRING_HOST_DEVICE constexpr BrickMask brick_mask() {
    CountSprings count;
    const int early = visit_brick_springs<shape.tx, shape.ty, shape.tz, shape.both, false>(count, 0);
    return {early, visit_brick_springs<shape.tx, shape.ty, shape.tz, shape.both, true>(count, early),
            shape.tile()};
}

/// The masks of a plain thread (TileSides). Conditions that several springs share are tested once.
struct FullTileMasks {
    static constexpr bool by_side = true;
    TileSides sides;
    std::uint32_t moving;  ///< bit n: the thread's particle n moves

    /// `words`: the complete masks of the thread's `particles` particles.
    template <class Words>
    VOXSPRING_HOST_DEVICE FullTileMasks(TileSides of, const Words& words, int particles)
        : sides(of), moving(0) {
        UNROLLED
        for (int n = 0; n < particles; ++n) moving |= words.moves(n) != 0 ? 1U << n : 0;
    }
    VOXSPRING_HOST_DEVICE bool spring(int /*bit*/, std::uint32_t crossed) const {
        return crossed == 0 || sides.has(crossed);
    }
    VOXSPRING_HOST_DEVICE std::uint32_t moves(int n) const { return moving & 1U << n; }
    static VOXSPRING_HOST_DEVICE bool exists(int /*n*/) { return true; }
};

/// The particles of a warp's tiles in the order of the lattice's rows, shape.tile() per lane: successive
/// lanes have successive particles along x, so that the warp writes whole sectors of memory. The lane's
/// particle number(n, j, k) is particle (i[n], j, k) of the tile of lane `lane[n]`.
template <BrickShape shape>
struct WarpRows {
    int lane[shape.tx], i[shape.tx];

    VOXSPRING_HOST_DEVICE WarpRows(const BrickStep& step, const BrickBlock& block, int thread) {
        UNROLLED
        for (int n = 0; n < shape.tx; ++n) {
            const int at = thread / 32 * 32 * shape.tx + 32 * n + thread % 32, tile = at / shape.tx;
            const TilePlace place(shape, block, tile);
            lane[n] = tile % 32;
            i[n] = at % shape.tx;
            slot_[n] = place.slot_of(shape, i[n], 0, 0);
            sy_[n] = place.sy;
            sz_[n] = place.sz;
            element_[n] = place.element_of(i[n], 0, 0, step.row, step.plane);
            row_[n] = std::size_t(place.dy) * step.row;
            plane_[n] = std::size_t(place.dz) * step.plane;
        }
    }
    /// Calls visit(number, slot, element) for each of the lane's particles.
    template <class Visit>
    VOXSPRING_HOST_DEVICE void visit(Visit visit) const {
        UNROLLED
        for (int k = 0; k < shape.tz; ++k) {
            UNROLLED
            for (int j = 0; j < shape.ty; ++j) {
                UNROLLED
                for (int n = 0; n < shape.tx; ++n)
                    visit(shape.number(n, j, k), slot_[n] + j * sy_[n] + k * sz_[n],
                          element_[n] + std::size_t(j) * row_[n] + std::size_t(k) * plane_[n]);
            }
        }
    }

private:
    int slot_[shape.tx], sy_[shape.tx], sz_[shape.tx];
    std::size_t element_[shape.tx], row_[shape.tx], plane_[shape.tx];
};

/// A thread's particles during a step. `increments_in_memory`: the increments x(t) - x(t - dt) stay in
/// memory, since registers have no room for them. A step reads and writes the increment of a particle when it
/// moves the particle.
template <class Terms, BrickShape shape, bool equal_edges, bool increments_in_memory = false>
class BrickTile {
public:
    static constexpr int particles = shape.tile();
    // The mask bits of the first late spring (visit_brick_springs()), of whether particle 0 moves, and of
    // whether particle 0 exists. `mask_words`: the number of words of mask bits per thread.
    static constexpr int late_bit = brick_mask<shape>().early, moves_bit = brick_mask<shape>().moves(0),
                         exists_bit = brick_mask<shape>().exists(0), mask_words = brick_mask<shape>().words();

    /// `increments`: where v of the thread's particles is, if it is in memory. The increments of a block's
    /// threads are interleaved there, so that those of a warp are side by side.
    VOXSPRING_HOST_DEVICE BrickTile(const BrickStep& step, const BrickBlock& block, int thread,
                                    float* increments = nullptr)
        : increments_(increments),
          place_(shape, block, thread),
          spacing_{float(place_.dx) * step.spacing.x, float(place_.dy) * step.spacing.y,
                   float(place_.dz) * step.spacing.z} {}

    /// The slot of particle (i, j, k) in shared memory, and its element in the lattice's arrays.
    VOXSPRING_HOST_DEVICE int slot(int i, int j, int k) const { return place_.slot_of(shape, i, j, k); }
    VOXSPRING_HOST_DEVICE std::size_t element(const BrickStep& step, int i, int j, int k) const {
        return place_.element_of(i, j, k, step.row, step.plane);
    }

    static VOXSPRING_HOST_DEVICE constexpr int number(int i, int j, int k) { return shape.number(i, j, k); }
    /// Calls visit(number, i, j, k) for each particle.
    template <class Visit>
    static VOXSPRING_HOST_DEVICE void visit_particles(Visit visit) {
        UNROLLED
        for (int k = 0; k < shape.tz; ++k) {
            UNROLLED
            for (int j = 0; j < shape.ty; ++j) {
                UNROLLED
                for (int i = 0; i < shape.tx; ++i) visit(number(i, j, k), i, j, k);
            }
        }
    }

    /// Loads the thread's particles from `points`, one half of the points, before the first step.
    VOXSPRING_HOST_DEVICE void start(const float* points) { load_own(points); }

    /// Bit n: particle n exists, and another brick lies beside it. `words`: see add_early().
    template <class Words>
    VOXSPRING_HOST_DEVICE std::uint32_t border(const BrickBlock& block, const Words& words) const {
        std::uint32_t bits = place_.border(shape, block);
        UNROLLED
        for (int n = 0; n < particles; ++n) {
            if (!words.exists(n)) bits &= ~(1U << n);
        }
        return bits;
    }
    /// The distance from the element of particle (0, 0, 0) to that of (i, j, k).
    VOXSPRING_HOST_DEVICE int from_first(const BrickStep& step, int i, int j, int k) const {
        return i * place_.dx + j * place_.dy * int(step.row) + k * place_.dz * int(step.plane);
    }

    /// The increment v of particle `number`, which a step overwrites. For formulations by increments only.
    VOXSPRING_HOST_DEVICE Vector<float> increment(int number) const {
        if constexpr (!increments_in_memory) return increment_[number];
        return load_axes(increments_ + 3 * number * shape.lanes(), std::size_t(shape.lanes()));
    }
    VOXSPRING_HOST_DEVICE void set_increment(int number, Vector<float> v) {
        if constexpr (increments_in_memory) {
            store_axes(increments_ + 3 * number * shape.lanes(), std::size_t(shape.lanes()), v);
        } else {
            increment_[number] = v;
        }
    }
    /// Words of memory that the increments of a block take.
    static constexpr int increment_words = 3 * particles * shape.lanes();

    /// Adds the forces of early springs (visit_brick_springs()), which need no points of other blocks.
    /// `points`: the half that this step reads. `words`, here and in the functions below: the thread's masks.
    /// words.exists(n) and words.moves(n) tell of particle n. words.spring(bit, crossed) tells whether a
    /// spring exists: by its bit or, if `by_side`, by the sides of the tile that it crosses.
    template <class Words>
    VOXSPRING_HOST_DEVICE void add_early(const BrickStep& step, const float* points, const Words& words) {
        visit_particles([&](int n, int, int, int) { force_[n] = {0, 0, 0}; });
        if (!keeps_own) load_own(points);
        Springs<Words> springs{*this, step, points, words};
        visit_brick_springs<shape.tx, shape.ty, shape.tz, shape.both, false>(springs, 0);
    }
    /// Adds the forces of the other springs, once the points of other blocks have come.
    template <class Words>
    VOXSPRING_HOST_DEVICE void add_late(const BrickStep& step, const float* points, const Words& words) {
        if (!keeps_own) load_own(points);
        Springs<Words> springs{*this, step, points, words};
        visit_brick_springs<shape.tx, shape.ty, shape.tz, shape.both, true>(springs, late_bit);
    }
    /// Moves the particles by one step. `next`: the half of `points` that is written. In formulations that
    /// are not by increments it holds x(t - dt) before. send(n, i, j, k, point) is called for each particle
    /// beside which another brick may lie. No branch skips a particle that does not exist: without branches
    /// the compiler fills the waits of one particle with the work of the others, and a step takes about half
    /// as long.
    template <class Words, class Send>
    VOXSPRING_HOST_DEVICE void integrate(const BrickStep& step, float* next, const Words& words, Send send) {
        visit_particles([&](int n, int i, int j, int k) {
            const int at = slot(i, j, k);
            const Vector<float> before = Terms::increments ? increment(n) : load(next, at);
            const Vector<float> change{
                component_change<Terms>(step, own_[n].x, before.x, force_[n].x, step.gravity.x),
                component_change<Terms>(step, own_[n].y, before.y, force_[n].y, step.gravity.y),
                component_change<Terms>(step, own_[n].z, before.z, force_[n].z, step.gravity.z)};
            if constexpr (Terms::increments) {
                Vector<float> v = before + change;
                if (words.moves(n) == 0) v = {0, 0, 0};
                set_increment(n, v);
                own_[n] = own_[n] + v;
            } else {
                move_predicated(change, words.moves(n), own_[n]);
            }
            store(next, at, own_[n]);
            if (shape.may_be_at_border(i, j, k)) send(n, i, j, k, own_[n]);
        });
    }

    static VOXSPRING_HOST_DEVICE Vector<float> load(const float* points, int slot) {
        return {points[slot], points[slot + shape.axis()], points[slot + 2 * shape.axis()]};
    }
    static VOXSPRING_HOST_DEVICE void store(float* points, int slot, Vector<float> point) {
        points[slot] = point.x;
        points[slot + shape.axis()] = point.y;
        points[slot + 2 * shape.axis()] = point.z;
    }

private:
    /// Whether particles stay in registers from step to step. A large tile leaves no registers for that, not
    /// even from early to late springs.
    static constexpr bool keeps_own = particles <= 8;
    VOXSPRING_HOST_DEVICE void load_own(const float* points) {
        visit_particles([&](int n, int i, int j, int k) { own_[n] = load(points, slot(i, j, k)); });
    }

    template <class Words>
    struct Springs {
        BrickTile& tile;
        const BrickStep& step;
        const float* points;
        const Words& words;

        VOXSPRING_HOST_DEVICE void both(int bit, int i, int j, int k, int i2, int j2, int k2) {
            const int c = spring_class(i2 - i, j2 - j, k2 - k), a = number(i, j, k), b = number(i2, j2, k2);
            if (!has_class<Terms>(c)) return;
            const Pull<float> spring = class_pull<Terms, equal_edges>(
                step, tile.spacing_, tile.own_[a] - tile.own_[b], c, i2 - i, j2 - j, k2 - k);
            const auto there = words.spring(bit, 0);
            // By side, a spring within the tile always exists, which lets the compiler simplify add_where().
            if constexpr (Words::by_side) {
                add_where(spring.offset, spring.density, there, tile.force_[a]);
                add_where(spring.offset, -spring.density, there, tile.force_[b]);
            } else {
                add_predicated(spring.offset, spring.density, there, tile.force_[a]);
                add_predicated(spring.offset, -spring.density, there, tile.force_[b]);
            }
        }
        VOXSPRING_HOST_DEVICE void half(int bit, int i, int j, int k, int i2, int j2, int k2) {
            const int c = spring_class(i2 - i, j2 - j, k2 - k), a = number(i, j, k);
            if (!has_class<Terms>(c)) return;
            const Vector<float> other = load(points, tile.slot(i2, j2, k2));
            const Pull<float> spring = class_pull<Terms, equal_edges>(
                step, tile.spacing_, tile.own_[a] - other, c, i2 - i, j2 - j, k2 - k);
            const std::uint32_t crossed = shape.crossed(i2, j2, k2);
            // Unless `by_side`, predicated instructions make a step shorter for large tiles and by
            // increments, and longer otherwise (docs/cuda-trials.md).
            if (Words::by_side ? crossed != 0 : !keeps_own || Terms::increments) {
                return add_predicated(spring.offset, spring.density, words.spring(bit, crossed),
                                      tile.force_[a]);
            }
            add_where(spring.offset, spring.density, words.spring(bit, crossed), tile.force_[a]);
        }
    };

    float* increments_;
    TilePlace place_;
    Vector<float> spacing_;
    Vector<float> own_[particles], force_[particles];
    Vector<float> increment_[Terms::increments && !increments_in_memory ? particles : 1];
};

}  // namespace voxspring::cuda
