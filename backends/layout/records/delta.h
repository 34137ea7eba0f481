// The argument of the kernel of delta-compressed lists (cuda/kernels/delta.h).
#pragma once

#include "backends/layout/records/implicit.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {

/// The number of particles in a slice. A slice is a run of successive particles that one warp steps.
inline constexpr int slice_particles = 32;

/// The eight rows of voxels along x around a particle's own row, by (dy, dz). The four rows beside its faces
/// come first.
inline constexpr int row_count = 8;
// clang-format off
#define NEIGHBOUR_ROWS(X) \
    X(0, -1, 0) X(1, 1, 0) X(2, 0, -1) X(3, 0, 1) X(4, -1, -1) X(5, 1, 1) X(6, 1, -1) X(7, -1, 1)
// clang-format on

/// The number of the row at (dy, dz), or row_count for the particle's own row.
VOXSPRING_HOST_DEVICE constexpr int row_number(int dy, int dz) {
    int number = row_count;
#define ROW(row, y, z) \
    if (dy == (y) && dz == (z)) number = row;
    NEIGHBOUR_ROWS(ROW)
#undef ROW
    return number;
}

/// What the particles of a slice share. Successive particles share a list (RowDeltas) that says where their
/// neighbours are (cuda/kernels/delta.h).
struct alignas(16) Slice {
    std::int32_t list;     ///< index of the list of the particle before the slice; -1: no such particle
    std::uint32_t starts;  ///< bit l: the next list serves particle l and those after it
    /// Where the slice's springs beyond the lattice begin in their arrays, in units of slice_particles
    /// elements: one slot of all particles of the slice.
    std::uint32_t off_lattice_begin;
    /// Slots per particle for springs beyond the lattice; 0: no particle of the slice has such a spring.
    std::uint32_t off_lattice_slots;
    bool operator==(const Slice&) const = default;
};

/// The deltas of four rows of a RowDeltas.
struct alignas(16) FourDeltas {
    std::int32_t row[4];
    bool operator==(const FourDeltas&) const = default;
};

/// A list: for each row, what to add to a particle's index to get the index of its neighbour at dx = 0. All
/// particles that share the list have the same deltas. The neighbours at dx = -1 and dx = 1 have the indices
/// before and after that one.
struct alignas(16) RowDeltas {
    FourDeltas rows[2];
    /// Bit r is set if row r has neighbours at dx = -1 and dx = 1 but none at dx = 0. Then the neighbour at
    /// dx = 1 has the index that a neighbour at dx = 0 would have.
    std::uint32_t gaps;
    std::uint32_t unused[3];
    bool operator==(const RowDeltas&) const = default;
};

/// Everything a step needs besides the particles' state: an ImplicitStep, whose grid is not used, and the
/// lists.
template <class Real>
struct DeltaStep : ImplicitStep<Real> {
    int particles;  ///< particle i is word first + i
    const Slice* slices;
    const RowDeltas* lists;
    // Springs beyond the lattice; null: there are none. Slot s of particle l of a slice is element
    // (off_lattice_begin + s) slice_particles + l. In an unused slot the neighbour is the particle itself, at
    // stiffness 0.
    const std::uint32_t* off_lattice_neighbour;
    const SpringConstants<Real>* off_lattice_constants;
    const SpringRest<Real>* off_lattice_rest;  ///< null in formulations on positions
    bool operator==(const DeltaStep&) const = default;
};

/// Slots of springs beyond the lattice are allocated and read in multiples of this.
inline constexpr int off_lattice_chunk = 2;

}  // namespace voxspring::layout
