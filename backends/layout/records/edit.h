// What an edit writes on the device (cuda/kernels/edit.h).
#pragma once

#include "backends/layout/records/delta.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {

/// A particle's new bits and the index of its word, or a table's new value and its index.
struct alignas(8) EditedWord {
    std::uint32_t word, bits;
};

/// New lists of some particles, one after the other, each with as many slots as the lists on the device.
template <class Real>
struct EditedRows {
    const std::uint32_t* particle;
    const std::uint32_t* bits;
    const std::uint32_t* neighbour;
    const SpringConstants<Real>* constants;    ///< null without a secondary list
    const SpringRest<Real>* off_lattice_rest;  ///< null if there is no such list
    bool squared;  ///< rest lengths are squares, from which the kernel measures lengths
};

/// A slice after an edit.
struct alignas(16) EditedSlice {
    std::uint32_t number;
    Slice slice;
};

/// A spring of the spring array that is taken away (stiffness 0), put back or added.
template <class Real>
struct EditedSpring {
    SpringEnds ends;
    /// If begin == end, the slot of the spring. If begin < end, the range in which a kernel searches for the
    /// slot: there springs ascend by `first`, and each particle is `first` in at most one of them.
    std::size_t begin, end;
    SpringConstants<Real> constants;
    SpringRest<Real> off_lattice_rest;
    bool squared;  ///< as in EditedRows
};

/// 16 bytes, which a thread moves at once.
struct alignas(16) ArgumentWord {
    std::uint32_t part[4];  // NOLINT(modernize-avoid-c-arrays)
};
/// Values that travel as an argument of a kernel's launch.
template <std::size_t words>
struct Argument {
    ArgumentWord word[words];  // NOLINT(modernize-avoid-c-arrays)
};
/// The size of the longest argument that a kernel may have on every device and driver.
inline constexpr std::size_t max_argument_bytes = 3840;
using ShortArgument = Argument<16>;
using LongArgument = Argument<max_argument_bytes / sizeof(ArgumentWord)>;

}  // namespace voxspring::layout
