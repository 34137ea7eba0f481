// Implicit addressing: a particle's neighbours are at fixed offsets in the grid, and its mask says which of
// them exist. The bodies of the kernels take the way of fetching neighbours as a parameter.
#pragma once

#include "cuda/kernels/motion.h"
#include "cuda/kernels/resting.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
template <class Real>
__device__ BlockOrigin block_origin(const ImplicitStep<Real>& step) {
    if (step.origins != nullptr) return step.origins[blockIdx.x];
    return {int(blockIdx.x * blockDim.x), int(blockIdx.y * blockDim.y), int(blockIdx.z * blockDim.z), 0};
}

/// Calls step_block(origin) for each block of voxels that this block of threads steps. step_block() returns
/// whether the thread's particle changed.
template <class Terms, class Real, class StepBlock>
__device__ void for_each_block(const ImplicitStep<Real>& step, StepBlock step_block) {
    if constexpr (Terms::compiled(term_resting)) {
        for_each_active_block(step.active, step_block);
    } else {
        step_block(block_origin(step));
    }
}
#endif

/// `steps` (-1, 0 or 1) times the spacing. For 0 it returns a literal 0, so that the compiler can simplify.
template <class Real>
VOXSPRING_HOST_DEVICE Real spaced(int steps, Real spacing) {
    return steps == 0 ? Real(0) : steps > 0 ? spacing : -spacing;
}

/// unit_pull() of a lattice spring from `here` to its neighbour `there` at (dx, dy, dz), which is mask bit
/// `bit`. `spacing`: that of `step`, or that of a mirrored warp, with some signs changed (mirrored_y in
/// backends/layout/records/resident.h).
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE Pull<Real> lattice_pull(const ImplicitStep<Real>& step, const Vector<Real>& spacing,
                                              const Point<Real, Terms::split>& here,
                                              const Point<Real, Terms::split>& there, int bit, int dx, int dy,
                                              int dz) {
    const SpringRest<Real> rest{{spaced(dx, spacing.x), spaced(dy, spacing.y), spaced(dz, spacing.z)},
                                step.deficit[bit / 2]};
    return unit_pull<Terms>(here - there, rest, step.rest_length[bit / 2], step.motion.shortest_squared);
}

/// The sums of pulls at stiffness 1, by spring group. With several materials, the sums of forces.
template <class Real>
struct GroupSums {
    Vector<Real> face{0, 0, 0}, edge{0, 0, 0}, corner{0, 0, 0};
};

/// Says that add_springs() visits all neighbours.
struct EveryNeighbour {
    static VOXSPRING_HOST_DEVICE constexpr bool has(int, int, int) { return true; }
};

/// Adds to `sums` the pulls of the springs of `self` to its `Chosen` neighbours. `neighbour(dx, dy, dz)` is
/// the point at that offset and `compliance(dx, dy, dz)` its compliance. Both are called for absent
/// neighbours too, so that no fetch waits for the mask. A selection then drops the pulls of absent
/// neighbours, so that a NaN in an inactive voxel does not spread. With term_bit_by_bit they are called only
/// for neighbours that exist. `full_stencil`: every neighbour of the groups that are compiled in exists, or
/// its pull is zero.
template <class Terms, bool full_stencil, class Chosen, class Real, class Neighbour, class Compliance>
VOXSPRING_HOST_DEVICE void add_springs(const ImplicitStep<Real>& step, const Vector<Real>& spacing,
                                       const Self<Real, Terms::split>& self, Neighbour neighbour,
                                       Compliance compliance, GroupSums<Real>& sums) {
    const bool materials = Terms::template has<term_materials>(step.compliance != nullptr);
    [[maybe_unused]] const Real own_compliance = materials ? compliance(0, 0, 0) : Real(0);
    // Unless bit_by_bit, all neighbours of a group are fetched before the first use. With few warps, as on a
    // small lattice, an SM has nothing else to do, and a step takes as long as the latencies that one thread
    // waits for one after the other.
    constexpr bool bit_by_bit = Terms::compiled(term_bit_by_bit);
#define FETCH_NEIGHBOUR(bit, dx, dy, dz)         \
    [[maybe_unused]] const auto neighbour##bit = \
        Chosen::has(dx, dy, dz) && !bit_by_bit ? neighbour(dx, dy, dz) : self.point;
#define ADD_SPRING(group, bit, dx, dy, dz)                                                                \
    if constexpr (Chosen::has(dx, dy, dz)) {                                                              \
        const bool exists = full_stencil || (self.bits >> (bit)&1U) != 0;                                 \
        if (!bit_by_bit || exists) {                                                                      \
            const auto there = bit_by_bit ? neighbour(dx, dy, dz) : neighbour##bit;                       \
            Pull<Real> pull = lattice_pull<Terms>(step, spacing, self.point, there, bit, dx, dy, dz);     \
            if (materials) pull.density *= fast_series_stiffness(own_compliance, compliance(dx, dy, dz)); \
            if (exists) sums.group = fused(pull.offset, pull.density, sums.group);                        \
        }                                                                                                 \
    }
#define ADD_FACE(bit, dx, dy, dz) ADD_SPRING(face, bit, dx, dy, dz)
#define ADD_EDGE(bit, dx, dy, dz) ADD_SPRING(edge, bit, dx, dy, dz)
#define ADD_CORNER(bit, dx, dy, dz) ADD_SPRING(corner, bit, dx, dy, dz)
    if (Terms::has_group(FACE_BITS, step.group_bits)) {
        FACE_NEIGHBOURS(FETCH_NEIGHBOUR)
        FACE_NEIGHBOURS(ADD_FACE)
    }
    if (Terms::has_group(EDGE_BITS, step.group_bits)) {
        EDGE_NEIGHBOURS(FETCH_NEIGHBOUR)
        EDGE_NEIGHBOURS(ADD_EDGE)
    }
    if (Terms::has_group(CORNER_BITS, step.group_bits)) {
        CORNER_NEIGHBOURS(FETCH_NEIGHBOUR)
        CORNER_NEIGHBOURS(ADD_CORNER)
    }
#undef FETCH_NEIGHBOUR
#undef ADD_SPRING
#undef ADD_FACE
#undef ADD_EDGE
#undef ADD_CORNER
}

/// The total force of the springs whose pulls are in `sums`.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE Vector<Real> force_of(const ImplicitStep<Real>& step, const GroupSums<Real>& sums) {
    const bool materials = Terms::template has<term_materials>(step.compliance != nullptr);
    Vector<Real> force{0, 0, 0};
    if (Terms::has_group(FACE_BITS, step.group_bits))
        force = materials ? sums.face : sums.face * step.stiffness[0];
    if (Terms::has_group(EDGE_BITS, step.group_bits))
        force = force + (materials ? sums.edge : sums.edge * step.stiffness[1]);
    if (Terms::has_group(CORNER_BITS, step.group_bits))
        force = force + (materials ? sums.corner : sums.corner * step.stiffness[2]);
    return force;
}

/// The force of all springs of `self`.
template <class Terms, bool full_stencil, class Real, class Neighbour, class Compliance>
VOXSPRING_HOST_DEVICE Vector<Real> implicit_force(const ImplicitStep<Real>& step,
                                                  const Self<Real, Terms::split>& self, Neighbour neighbour,
                                                  Compliance compliance) {
    GroupSums<Real> sums;
    add_springs<Terms, full_stencil, EveryNeighbour>(step, step.spacing, self, neighbour, compliance, sums);
    return force_of<Terms>(step, sums);
}

/// Whether `yes` is true in all threads that run this together.
VOXSPRING_HOST_DEVICE inline bool all_say(bool yes) {
#ifdef __CUDA_ARCH__
    return __all_sync(__activemask(), int(yes)) != 0;
#else
    return yes;
#endif
}

/// Whether the particles of all threads that run this together have a full stencil. `bits` is this thread's
/// mask. Without term_full_stencil the result is false.
template <class Terms>
VOXSPRING_HOST_DEVICE bool all_full_stencils(std::uint32_t bits) {
    if constexpr (!Terms::compiled(term_full_stencil)) {
        return false;
    } else {
        return all_say((bits & Terms::groups) == Terms::groups);
    }
}

/// Steps the particle of element `index`, if there is one. `self` is what Reader::self() returned for the
/// element. Returns whether a bit of the particle's state changed or, if the launch only checks, would
/// change.
template <class Terms, class Real, class Neighbour, class Compliance>
VOXSPRING_HOST_DEVICE bool step_voxel(const ImplicitStep<Real>& step, int index,
                                      const Self<Real, Terms::split>& self, const Output<Real>& output,
                                      Neighbour neighbour, Compliance compliance) {
    if (self.bits == 0) return false;
    const PreviousOrVelocity<Real> before = load_before<Terms>(output, index);
    const Vector<Real> force = all_full_stencils<Terms>(self.bits)
                                   ? implicit_force<Terms, true>(step, self, neighbour, compliance)
                                   : implicit_force<Terms, false>(step, self, neighbour, compliance);
    const bool stores = !Terms::compiled(term_resting) || !step.active.only_checks;
    return integrate_and_store<Terms>(step.motion, output, index, self, before, force, stores);
}

/// Fetches neighbours from memory: `current.point(index, dx)` is the point of element index + dx.
template <class Current>
struct GridNeighbours {
    const Current& current;
    int index, row, slice;
    VOXSPRING_HOST_DEVICE auto operator()(int dx, int dy, int dz) const {
        return current.point(index + dy * row + dz * slice, dx);
    }
};

/// The compliance of the voxels around element `index`.
template <class Real>
struct GridCompliance {
    const Real* compliance;
    int index, row, slice;
    VOXSPRING_HOST_DEVICE Real operator()(int dx, int dy, int dz) const {
        return compliance[index + dy * row + dz * slice + dx];
    }
};

/// Steps the particle of voxel (x, y, z), if there is one, with neighbours from memory. The voxel may lie
/// outside of the lattice. Returns what step_voxel() returns.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE bool step_from_memory(const ImplicitStep<Real>& step, int x, int y, int z,
                                            const Current& current, const Output<Real>& output) {
    if (x >= step.nx || y >= step.ny || z >= step.nz) return false;
    const int row = step.nx;
    const int slice = step.nx * step.ny;
    const int index = step.first + x + row * y + slice * z;
    return step_voxel<Terms>(step, index, current.self(index), output,
                             GridNeighbours<Current>{current, index, row, slice},
                             GridCompliance<Real>{step.compliance, index, row, slice});
}

/// Three slices of a tile of W x H particles and a frame of one particle around it, in shared memory: the
/// paper's Figure 4. Each axis is a separate array, so that neighbouring threads read neighbouring banks. Low
/// parts take three more arrays.
template <class Real, bool split, int W, int H>
struct Tile {
    Real axis[split ? 6 : 3][3][H + 2][W + 2];

    VOXSPRING_HOST_DEVICE void put(int first, int k, int cy, int cx, Vector<Real> v) {
        axis[first][k][cy][cx] = v.x;
        axis[first + 1][k][cy][cx] = v.y;
        axis[first + 2][k][cy][cx] = v.z;
    }
    VOXSPRING_HOST_DEVICE Vector<Real> get(int first, int k, int cy, int cx) const {
        return {axis[first][k][cy][cx], axis[first + 1][k][cy][cx], axis[first + 2][k][cy][cx]};
    }

    /// Loads the three particles of column (cx, cy) of the tile, one above the other, and returns the middle
    /// one, which is element `index`.
    template <class Current>
    VOXSPRING_HOST_DEVICE Self<Real, split> load(int cx, int cy, int index, int slice,
                                                 const Current& current) {
        Self<Real, split> middle{};
        for (int k = 0; k < 3; ++k) {
            const Self<Real, split> particle = current.self(index + (k - 1) * slice);
            put(0, k, cy, cx, particle.point.high);
            if constexpr (split) put(3, k, cy, cx, particle.point.low);
            if (k == 1) middle = particle;
        }
        return middle;
    }

    /// Loads the column of thread (tx, ty), and the columns of the frame next to it. Returns the thread's
    /// particle. Places outside of the lattice may stay unset: pulls from there are dropped by the mask.
    template <class Current>
    VOXSPRING_HOST_DEVICE Self<Real, split> fill(int tx, int ty, int index, int row, int slice,
                                                 const Current& current) {
        const Self<Real, split> self = load(tx + 1, ty + 1, index, slice, current);
        const bool left = tx == 0, right = tx == W - 1, front = ty == 0, back = ty == H - 1;
        if (left) load(0, ty + 1, index - 1, slice, current);
        if (right) load(W + 1, ty + 1, index + 1, slice, current);
        if (front) load(tx + 1, 0, index - row, slice, current);
        if (back) load(tx + 1, H + 1, index + row, slice, current);
        if (left && front) load(0, 0, index - row - 1, slice, current);
        if (right && front) load(W + 1, 0, index - row + 1, slice, current);
        if (left && back) load(0, H + 1, index + row - 1, slice, current);
        if (right && back) load(W + 1, H + 1, index + row + 1, slice, current);
        return self;
    }
};

template <class Real, bool split, int W, int H>
struct TileNeighbours {
    const Tile<Real, split, W, H>& tile;
    int tx, ty;
    VOXSPRING_HOST_DEVICE Point<Real, split> operator()(int dx, int dy, int dz) const {
        const Vector<Real> high = tile.get(0, 1 + dz, ty + 1 + dy, tx + 1 + dx);
        if constexpr (split) {
            return {high, tile.get(3, 1 + dz, ty + 1 + dy, tx + 1 + dx)};
        } else {
            return {high};
        }
    }
};

}  // namespace voxspring::cuda
