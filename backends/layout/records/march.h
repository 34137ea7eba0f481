// The arguments of the kernel of cuda_march (cuda/kernels/march.h), whose blocks step a lattice plane by
// plane along z: how blocks cover the lattice, and the springs that each thread evaluates, in the order of
// the bits of its masks.
#pragma once

#include "backends/layout/records/loops.h"
#include "backends/layout/records/springs.h"
#include "backends/physics/neighbours.h"

namespace voxspring::layout {

/// How a block covers a tile, the rectangle of particles that it steps in each plane. A warp has `lanes`
/// threads along x and 32 / lanes along y, and a block has `wide` x `high` warps. Each thread has `rows` rows
/// of two particles per plane. A window is the shared memory for one plane of the tile. The block uses its
/// windows in turn: `planes` windows of positions, and `previous_windows` windows of the values that the step
/// overwrites (x or u at t - dt, or increments v).
struct MarchShape {
    int rows, lanes, wide, high, planes, previous_windows;

    VOXSPRING_HOST_DEVICE constexpr int warps() const { return wide * high; }
    VOXSPRING_HOST_DEVICE constexpr int threads() const { return 32 * warps(); }
    /// width(), height(): the number of particles of a tile along x and along y.
    VOXSPRING_HOST_DEVICE constexpr int width() const { return 2 * lanes * wide; }
    VOXSPRING_HOST_DEVICE constexpr int height() const { return rows * (32 / lanes) * high; }
    /// column(), row(): where in the tile the first particle of thread `number` is.
    VOXSPRING_HOST_DEVICE constexpr int column(int number) const {
        return (number / 32 % wide) * 2 * lanes + 2 * (number % lanes);
    }
    VOXSPRING_HOST_DEVICE constexpr int row(int number) const {
        return ((number / 32 / wide) * (32 / lanes) + number % 32 / lanes) * rows;
    }

    // A window of positions holds the tile and a frame of the particles around it. In front and behind (along
    // y) the frame is one particle wide. To the left and right (along x) it is as wide as 16 bytes, because a
    // copy begins at a multiple of 16 bytes. A window has all x, then all y, then all z. The functions below
    // count elements; `real` is the size of an element in bytes.
    static VOXSPRING_HOST_DEVICE constexpr int margin(int real) { return 16 / real; }
    VOXSPRING_HOST_DEVICE constexpr int pitch(int real) const { return width() + 2 * margin(real); }
    VOXSPRING_HOST_DEVICE constexpr int axis(int real) const { return pitch(real) * (height() + 2); }
    /// The index of the first particle of thread `number` in a window of positions.
    VOXSPRING_HOST_DEVICE constexpr int own(int number, int real) const {
        return (row(number) + 1) * pitch(real) + column(number) + margin(real);
    }
    // Windows of the values that the step overwrites have no frame.
    VOXSPRING_HOST_DEVICE constexpr int before_axis() const { return width() * height(); }
    VOXSPRING_HOST_DEVICE constexpr int before_own(int number) const {
        return row(number) * width() + column(number);
    }

    /// Bytes from one window to the next: a multiple of 128, because a copy needs a destination aligned to
    /// 128.
    VOXSPRING_HOST_DEVICE constexpr int window_bytes(int real) const {
        return (3 * axis(real) * real + 127) / 128 * 128;
    }
    VOXSPRING_HOST_DEVICE constexpr int before_bytes(int real) const {
        return (3 * before_axis() * real + 127) / 128 * 128;
    }
    /// Bytes of shared memory per block: all windows, and two barriers of 8 bytes for each window.
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
    /// The index in MarchStep::words of the first mask word of the item. An item has one word per thread
    /// (PlaneMask) for each plane from `begin` to `end` (inclusive), or no words if all its warps have full
    /// stencils.
    std::size_t words;
    /// One bit per warp, set if all particles of the warp exist, move and have every spring. Only springs
    /// that would leave the lattice at its first or last column or plane may be missing.
    std::size_t full_stencils;
    bool operator==(const MarchItem&) const = default;
};

/// The number of classes of lattice springs. Springs along x, y and z are of class 0, 1 and 2; diagonal
/// springs in the planes xy, xz and yz are of class 3, 4 and 5.
inline constexpr int spring_classes = 6;
VOXSPRING_HOST_DEVICE constexpr int spring_class(int dx, int dy, int dz) {
    if (dz == 0) return dy == 0 ? 0 : dx == 0 ? 1 : 3;
    return dx != 0 ? 4 : dy != 0 ? 5 : 2;
}
/// The mask bits of the spring group (face or edge springs) to which class k belongs.
VOXSPRING_HOST_DEVICE constexpr std::uint32_t bits_of_class(int k) { return k < 3 ? FACE_BITS : EDGE_BITS; }

/// Everything that a step needs besides the particles' state.
template <class Real>
struct MarchStep {
    int nx, ny, nz;
    std::size_t row, plane, axis;  ///< elements from one row, plane or axis to the next
    const MarchItem* items;
    const std::uint64_t* words;
    Vector<Real> spacing;
    /// For each class the rest length in formulations by increments; otherwise 1 / rest length as
    /// inverse_root() computes it.
    Real rest_length[spring_classes];
    Real deficit[spring_classes];  ///< l^2 - |offset|^2 of each class (RestSpring)
    /// For each class the stiffness in formulations by increments; otherwise stiffness times rest length. If
    /// this number is equal for all edge springs (the kernel's EQUAL_EDGES), the elements are in units of it.
    Real stiffness[spring_classes];
    Real scale;            ///< the unit of `stiffness`, or 1, times dt^2 / mass
    Vector<Real> gravity;  ///< acceleration times dt^2
    Real damping, retained;
    Real shortest_squared;
    bool operator==(const MarchStep&) const = default;
};

/// The L2 cache may be told to keep MarchPlan::kept_planes of every `kept_of` successive planes.
inline constexpr int kept_of = 8;

/// A CUtensorMap, which describes an array of vectors to the copy engine: its dimensions are x, y, z of the
/// lattice and the three axes of the vectors.
struct alignas(128) TensorMap {
    std::uint64_t opaque[16];
    bool operator==(const TensorMap&) const = default;
};

/// The arrays from which threads fill the windows if no copy engine does: `positions` has x or u at t;
/// `before` has what the step overwrites (x or u at t - dt or, by increments, v).
template <class Real>
struct MarchArrays {
    const Real* positions;
    const Real* before;
    bool operator==(const MarchArrays&) const = default;
};

/// The arrays that a step writes: `next` gets x or u at t + dt and, in formulations by increments,
/// `increment` gets the new v in place of the old. In other formulations `next` holds x or u at t - dt before
/// the step.
template <class Real>
struct MarchOutput {
    Real* next;
    Real* increment;
};

/// The bits of the mask word with which a thread treats the arrival of a plane. From the lowest on: one per
/// spring of visit_springs(), set if the spring exists; one per particle of the thread in the plane before,
/// set if it moves (moves()); one per row of the thread in that plane, set if it has a particle (stored()).
template <int rows>
struct PlaneMask {
    static constexpr int springs = 23 * rows + 8;
    static VOXSPRING_HOST_DEVICE constexpr int moves(int r, int c) { return springs + 2 * r + c; }
    static VOXSPRING_HOST_DEVICE constexpr int stored(int r) { return springs + 2 * rows + r; }
    static_assert(springs + 3 * rows <= 64);
};

/// Visits every spring that a thread evaluates when a plane arrives in shared memory, each with its mask bit.
/// Particles are named by plane (1: the one that arrived, 0: the one before), row and column. The thread's
/// particles are in rows 0 to rows - 1 of columns 0 and 1. visit.both(bit, ...) is a spring between two of
/// them. visit.half(bit, ...) is a spring from one of them to a particle of another thread, which evaluates
/// the spring too. With two rows, a thread evaluates 13.5 springs per particle. If each particle evaluated
/// all of its springs, it would be 18.
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
    // Springs to particles of the threads on the left and on the right.
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
    // Springs to particles of the threads in front and behind.
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
