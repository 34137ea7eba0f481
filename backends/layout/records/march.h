// The arguments of the march along z (cuda/kernels/march.h): how blocks cover the lattice, and which springs
// a thread evaluates, in the order of its masks' bits.
#pragma once

#include "backends/layout/records/loops.h"
#include "backends/layout/records/springs.h"
#include "backends/physics/neighbours.h"

namespace voxspring::layout {

/// How a block covers a tile. A warp has `lanes` threads along x and 32 / lanes along y, and a block has
/// `wide` x `high` warps. A thread has `rows` rows of two particles in each plane. A window is one plane of
/// the tile in shared memory. There are two rings: `planes` windows of positions, and `previous_windows`
/// windows of what the step overwrites.
struct MarchShape {
    int rows, lanes, wide, high, planes, previous_windows;

    VOXSPRING_HOST_DEVICE constexpr int warps() const { return wide * high; }
    VOXSPRING_HOST_DEVICE constexpr int threads() const { return 32 * warps(); }
    /// Columns of particles per tile.
    VOXSPRING_HOST_DEVICE constexpr int width() const { return 2 * lanes * wide; }
    VOXSPRING_HOST_DEVICE constexpr int height() const { return rows * (32 / lanes) * high; }
    /// Column and row in the tile of the first particle of thread `number`.
    VOXSPRING_HOST_DEVICE constexpr int column(int number) const {
        return (number / 32 % wide) * 2 * lanes + 2 * (number % lanes);
    }
    VOXSPRING_HOST_DEVICE constexpr int row(int number) const {
        return ((number / 32 / wide) * (32 / lanes) + number % 32 / lanes) * rows;
    }

    // A window of positions holds the tile and a frame. In front and behind, the frame is one particle wide.
    // To the left and right it has as many particles as 16 bytes hold, because a copy begins at a multiple of
    // 16 bytes. The axes follow one another. These functions count elements; `real` is the bytes of one.
    static VOXSPRING_HOST_DEVICE constexpr int margin(int real) { return 16 / real; }
    VOXSPRING_HOST_DEVICE constexpr int pitch(int real) const { return width() + 2 * margin(real); }
    VOXSPRING_HOST_DEVICE constexpr int axis(int real) const { return pitch(real) * (height() + 2); }
    /// The element in a window of the first particle of thread `number`.
    VOXSPRING_HOST_DEVICE constexpr int own(int number, int real) const {
        return (row(number) + 1) * pitch(real) + column(number) + margin(real);
    }
    // A window of what the step overwrites has no frame.
    VOXSPRING_HOST_DEVICE constexpr int before_axis() const { return width() * height(); }
    VOXSPRING_HOST_DEVICE constexpr int before_own(int number) const {
        return row(number) * width() + column(number);
    }

    /// Bytes from one window to the next: a multiple of 128, as the destination of a copy has to be.
    VOXSPRING_HOST_DEVICE constexpr int window_bytes(int real) const {
        return (3 * axis(real) * real + 127) / 128 * 128;
    }
    VOXSPRING_HOST_DEVICE constexpr int before_bytes(int real) const {
        return (3 * before_axis() * real + 127) / 128 * 128;
    }
    /// Both rings, and two barriers of 8 bytes per window.
    VOXSPRING_HOST_DEVICE constexpr int shared_bytes(int real) const {
        return planes * window_bytes(real) + previous_windows * before_bytes(real) +
               16 * (planes + previous_windows);
    }
    bool operator==(const MarchShape&) const = default;
};

/// The work of one block: planes `begin` to `end` (exclusive) of the tile whose first particle is in column
/// (x, y).
struct alignas(16) MarchItem {
    int x, y, begin, end;
    /// Index in MarchStep::words of the item's first mask word. For each plane from `begin` to `end`
    /// (inclusive) there is one word per thread (PlaneMask). If all warps have full stencils, there is none.
    std::size_t words;
    /// One bit per warp: all its particles exist, move and have every spring, except springs that would leave
    /// the lattice at its first or last column or plane.
    std::size_t full_stencils;
    bool operator==(const MarchItem&) const = default;
};

/// Classes of lattice springs by direction, up to sign: along x, y, z, and in the planes xy, xz, yz.
inline constexpr int spring_classes = 6;
VOXSPRING_HOST_DEVICE constexpr int spring_class(int dx, int dy, int dz) {
    if (dz == 0) return dy == 0 ? 0 : dx == 0 ? 1 : 3;
    return dx != 0 ? 4 : dy != 0 ? 5 : 2;
}
/// The mask bits of the group that springs of class k belong to.
VOXSPRING_HOST_DEVICE constexpr std::uint32_t bits_of_class(int k) { return k < 3 ? FACE_BITS : EDGE_BITS; }

/// Everything that a step needs besides where the particles are.
template <class Real>
struct MarchStep {
    int nx, ny, nz;
    std::size_t row, plane, axis;  ///< elements from one row, plane or axis to the next
    const MarchItem* items;
    const std::uint64_t* words;
    Vector<Real> spacing;
    /// In formulations by increments the rest length, otherwise 1 / rest length as inverse_root() computes
    /// it.
    Real rest_length[spring_classes];
    Real deficit[spring_classes];  ///< RestSpring::deficit
    /// In formulations by increments the stiffness of each class, otherwise stiffness times rest length. If
    /// this number is equal for all edge springs (the kernel's EQUAL_EDGES), it is the unit for all classes.
    Real stiffness[spring_classes];
    Real scale;            ///< the unit of `stiffness`, or 1, times dt^2 / mass
    Vector<Real> gravity;  ///< times dt^2
    Real damping, retained;
    Real shortest_squared;
    bool operator==(const MarchStep&) const = default;
};

/// The L2 cache may be told to keep MarchPlan::kept_planes of every `kept_of` successive planes.
inline constexpr int kept_of = 8;

/// A CUtensorMap: x, y, z of a lattice and the three axes of its vectors as one tensor.
struct alignas(128) TensorMap {
    std::uint64_t opaque[16];
    bool operator==(const TensorMap&) const = default;
};

/// What a step reads if threads, not a copy engine, fill windows: x or u at t, and what it overwrites.
template <class Real>
struct MarchArrays {
    const Real* positions;
    const Real* before;
    bool operator==(const MarchArrays&) const = default;
};

/// What a step writes: x or u at t + dt and, in formulations by increments, v in place. In the formulations
/// `position` and `displacement`, `next` holds x or u at t - dt before the step.
template <class Real>
struct MarchOutput {
    Real* next;
    Real* increment;
};

/// The bits of a thread's mask word when a plane arrives. Per spring of visit_springs(): it exists. Per
/// particle of the previous plane: it moves. Per row of that plane: it has a particle.
template <int rows>
struct PlaneMask {
    static constexpr int springs = 23 * rows + 8;
    static VOXSPRING_HOST_DEVICE constexpr int moves(int r, int c) { return springs + 2 * r + c; }
    static VOXSPRING_HOST_DEVICE constexpr int stored(int r) { return springs + 2 * rows + r; }
    static_assert(springs + 3 * rows <= 64);
};

/// Visits every spring that a thread evaluates when a plane arrives, each with its bit. Particles are named
/// by plane (1: the one that arrived, 0: the one before), row and column. The thread's particles are in rows
/// 0 to rows - 1 of columns 0 and 1. visit.both(bit, ...) is a spring between two of them. visit.half(bit,
/// ...) is a spring from one of them to a particle of another thread, which evaluates the spring too. If
/// there are two rows, a thread evaluates 13.5 springs per particle. If each particle evaluated all of its
/// springs, it would be 18.
template <int rows, class Visit>
VOXSPRING_HOST_DEVICE void visit_springs(Visit& visit) {
    int bit = 0;
    UNROLLED
    for (int r = 0; r < rows; ++r) {
        visit.both(bit++, 1, r, 0, 1, r, 1);
        if (r + 1 == rows) continue;
        visit.both(bit++, 1, r, 0, 1, r + 1, 0);
        visit.both(bit++, 1, r, 1, 1, r + 1, 1);
        visit.both(bit++, 1, r, 0, 1, r + 1, 1);
        visit.both(bit++, 1, r, 1, 1, r + 1, 0);
    }
    // Springs to the left and right.
    UNROLLED
    for (int r = 0; r < rows; ++r) {
        UNROLLED
        for (int c = 0; c < 2; ++c) {
            const int x = c == 0 ? -1 : 2;
            visit.half(bit++, 1, r, c, 1, r, x);
            if (r > 0) visit.half(bit++, 1, r - 1, c, 1, r, x);
            if (r + 1 < rows) visit.half(bit++, 1, r + 1, c, 1, r, x);
            visit.half(bit++, 0, r, c, 1, r, x);
        }
    }
    // Springs from the thread's particles in the plane that arrived to those in the plane before.
    UNROLLED
    for (int r = 0; r < rows; ++r) {
        UNROLLED
        for (int c = 0; c < 2; ++c) {
            visit.both(bit++, 0, r, c, 1, r, c);
            visit.both(bit++, 0, r, c, 1, r, 1 - c);
            if (r > 0) visit.both(bit++, 0, r, c, 1, r - 1, c);
            if (r + 1 < rows) visit.both(bit++, 0, r, c, 1, r + 1, c);
        }
    }
    // Springs to the rows in front and behind.
    UNROLLED
    for (int side = 0; side < 2; ++side) {
        const int r = side == 0 ? 0 : rows - 1, y = side == 0 ? -1 : rows;
        UNROLLED
        for (int c = 0; c < 2; ++c) {
            UNROLLED
            for (int dx = -1; dx <= 1; ++dx) visit.half(bit++, 1, r, c, 1, y, c + dx);
            visit.half(bit++, 0, r, c, 1, y, c);
            visit.half(bit++, 1, r, c, 0, y, c);
        }
    }
    UNROLLED
    for (int r = 0; r < rows; ++r) {
        visit.half(bit++, 1, r, 0, 0, r, -1);
        visit.half(bit++, 1, r, 1, 0, r, 2);
    }
}

}  // namespace voxspring::layout
