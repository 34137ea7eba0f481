// Active tiles of 2 x 2 x 2 voxels as a list: every thread steps one tile, or a share of one. A thread
// computes the springs between its particles once, and reads each neighbour once. This is the body of the
// kernel, which needs no shared memory: what successive tiles read lies side by side in memory, or nearly so,
// and L1 holds what several read.
#pragma once

#include "backends/layout/records/tiles.h"
#include "cuda/kernels/march.h"

namespace voxspring::cuda {

/// Reads a number past L1 that only this thread reads in a step. The load must not be moved before the wait
/// for the previous step (AWAIT_STEP_BEFORE).
template <class Real>
VOXSPRING_HOST_DEVICE Real load_once(const Real* from) {
#ifdef __CUDA_ARCH__
    Real value;
    if constexpr (sizeof(Real) == sizeof(float)) {
        asm volatile("ld.global.cg.f32 %0, [%1];" : "=f"(value) : "l"(from));
    } else {
        asm volatile("ld.global.cg.f64 %0, [%1];" : "=d"(value) : "l"(from));
    }
    return value;
#else
    return *from;
#endif
}
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> load_tile_axes_once(const Real* from) {
    return {load_once(from), load_once(from + tile_axis), load_once(from + 2 * tile_axis)};
}

/// The entries of the eight rows of tiles around a tile's own row.
struct TileRows {
    TileRow row[tile_rows];

    VOXSPRING_HOST_DEVICE explicit TileRows(const TileRow* rows, std::uint32_t tile) {
        const TileRow* const from =
            rows + std::size_t(tile / group_tiles) * tile_rows * group_tiles + tile % group_tiles;
        UNROLLED
        for (std::uint32_t r = 0; r < tile_rows; ++r) row[r] = from[r * group_tiles];
    }
};

/// A tile during a step, as one of its threads sees it: number `thread` of `threads`, which steps its share
/// of the particles. Springs are visited in the order of the whole tile, so that bits do not depend on the
/// number of threads. `at`: x or u at t.
template <class Terms, bool equal_edges, int threads, int thread, class Real>
class SteppedTile {
public:
    VOXSPRING_HOST_DEVICE SteppedTile(const TileStep<Real>& step, const TileRows& rows, const Real* at,
                                      const MarchOutput<Real>& output, std::uint32_t tile)
        : step_(step), rows_(rows), at_(at), output_(output), tile_(tile), mask_(step.masks[tile]) {
        UNROLLED
        for (int n = 0; n < tile_particles; ++n) {
            const std::size_t element = tile_element(tile, n);
            own_[n] = load_axes(at + element, tile_axis);
            if (!steps(n)) continue;
            before_[n] = load_tile_axes_once((Terms::increments ? output.increment : output.next) + element);
            force_[n] = {0, 0, 0};
        }
    }

    VOXSPRING_HOST_DEVICE void both(int bit, int n, int m) {
        const int dx = tile_x(m) - tile_x(n), dy = tile_y(m) - tile_y(n), dz = tile_z(m) - tile_z(n);
        const int c = spring_class(dx, dy, dz);
        if (!has_class<Terms>(c) || !(steps(n) || steps(m))) return;
        const Pull<Real> spring =
            class_pull<Terms, equal_edges>(step_, step_.spacing, own_[n] - own_[m], c, dx, dy, dz);
        if (steps(n)) add_predicated(spring.offset, spring.density, mask_.bit(bit), force_[n]);
        if (steps(m)) add_predicated(spring.offset, -spring.density, mask_.bit(bit), force_[m]);
    }
    VOXSPRING_HOST_DEVICE void point(int i, int j, int k) {
        const auto beyond = [](int c) { return c < 0 ? -1 : c > 1 ? 1 : 0; };
        const int dx = beyond(i), dy = beyond(j), dz = beyond(k);
        const TileRow row = dy == 0 && dz == 0 ? TileRow::make(tile_, true) : rows_.row[tile_row(dy, dz)];
        other_ = load_axes(at_ + tile_element(row.at(dx), (i & 1) + 2 * (j & 1) + 4 * (k & 1)), tile_axis);
    }
    VOXSPRING_HOST_DEVICE void half(int bit, int n, int i, int j, int k) {
        const int dx = i - tile_x(n), dy = j - tile_y(n), dz = k - tile_z(n), c = spring_class(dx, dy, dz);
        if (!has_class<Terms>(c) || !steps(n)) return;
        const Pull<Real> spring =
            class_pull<Terms, equal_edges>(step_, step_.spacing, own_[n] - other_, c, dx, dy, dz);
        add_predicated(spring.offset, spring.density, mask_.bit(bit), force_[n]);
    }

    VOXSPRING_HOST_DEVICE void integrate() const {
        UNROLLED
        for (int n = 0; n < tile_particles; ++n) {
            if (!steps(n)) continue;
            const std::size_t element = tile_element(tile_, n);
            const bool moves = mask_.bit(TileMask::moves(n)) != 0;
            const Vector<Real> before = before_[n];
            Vector<Real> point{
                integrate_component<Terms>(step_, own_[n].x, before.x, force_[n].x, step_.gravity.x),
                integrate_component<Terms>(step_, own_[n].y, before.y, force_[n].y, step_.gravity.y),
                integrate_component<Terms>(step_, own_[n].z, before.z, force_[n].z, step_.gravity.z)};
            if constexpr (Terms::increments) {
                if (!moves) point = {0, 0, 0};
                store_axes(output_.increment + element, tile_axis, point);
                point = own_[n] + point;
            } else {
                if (!moves) point = own_[n];
            }
            store_axes(output_.next + element, tile_axis, point);
        }
    }

private:
    /// Whether the thread steps particle `n`. The tile's other particles are only read.
    static VOXSPRING_HOST_DEVICE constexpr bool steps(int n) {
        return n / (tile_particles / threads) == thread;
    }

    const TileStep<Real>& step_;
    const TileRows& rows_;
    const Real* const at_;
    const MarchOutput<Real>& output_;
    const std::uint32_t tile_;
    const TileMask mask_;
    Vector<Real> own_[tile_particles], before_[tile_particles], force_[tile_particles], other_{};
};

/// Takes a step of tile number `tile` as thread number `thread` of the tile's `threads` threads. Each thread
/// number has separate code, which steps no particles of the other threads. All lanes of a warp have the same
/// number.
template <class Terms, bool equal_edges, int threads, int coded = 0, class Real>
VOXSPRING_HOST_DEVICE void step_tile(const TileStep<Real>& step, const TileRows& rows, const Real* at,
                                     const MarchOutput<Real>& output, std::uint32_t tile, unsigned thread) {
    if constexpr (coded + 1 < threads) {
        if (thread != coded)
            return step_tile<Terms, equal_edges, threads, coded + 1>(step, rows, at, output, tile, thread);
    }
    SteppedTile<Terms, equal_edges, threads, coded, Real> stepped(step, rows, at, output, tile);
    visit_tile_springs(stepped);
    stepped.integrate();
}

}  // namespace voxspring::cuda
