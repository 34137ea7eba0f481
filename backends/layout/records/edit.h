// What an edit writes on the device (cuda/kernels/edit.h).
#pragma once

#include "backends/layout/records/delta.h"
#include "backends/layout/records/springs.h"

namespace voxspring::cuda {

/// A particle's new bits, by its word; or what a table has anew, by where.
struct alignas(8) EditedWord {
    std::uint32_t word, bits;
};

/// New lists of some particles, `shape.slots` a particle, one particle after the other.
template <class Real>
struct EditedRows {
    const std::uint32_t* particle;
    const std::uint32_t* bits;
    const std::uint32_t* neighbour;
    const SpringConstants<Real>* constants;    ///< null without a secondary list
    const SpringRest<Real>* off_lattice_rest;  ///< null where there is no such list
    bool squared;                              ///< whether rest lengths are, and have to be measured
};

/// A slice as an edit leaves it.
struct alignas(16) EditedSlice {
    std::uint32_t number;
    Slice slice;
};

/// A spring of the spring array, taken away (stiffness 0), put back or added.
template <class Real>
struct EditedSpring {
    SpringEnds ends;
    /// Its slot, or, where begin < end, the range in which it is the one with this `first`: springs of a
    /// direction ascend by it.
    std::size_t begin, end;
    SpringConstants<Real> constants;
    SpringRest<Real> off_lattice_rest;
    bool squared;  ///< as in EditedRows
};

}  // namespace voxspring::cuda
