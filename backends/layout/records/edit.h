// What an edit (a cut or suture of springs) writes on the device (cuda/kernels/edit.h).
#pragma once

#include "backends/layout/records/delta.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {

/// A new value and its index: the new bits of the particle whose word has index `word`, or a new element of a
/// table.
struct alignas(8) EditedWord {
    std::uint32_t word, bits;
};

/// New neighbour lists of some particles, one list after the other, each with as many slots as a list on the
/// device. With delta-compressed lists, columns of springs beyond the lattice (OffLatticeLists) take the
/// place of these lists, and `bits` is null.
template <class Real>
struct EditedRows {
    const std::uint32_t* particle;
    const std::uint32_t* bits;
    const std::uint32_t* neighbour;
    const SpringConstants<Real>* constants;    ///< null if constants are stored per spring group
    const SpringRest<Real>* off_lattice_rest;  ///< null if there is none to write
    bool squared;  ///< `constants` has squares of rest lengths; the kernel measures the lengths
};

/// A slice (delta.h) as it is after an edit, and its number.
struct alignas(16) EditedSlice {
    std::uint32_t number;
    Slice slice;
};

/// A spring of the spring array (scatter.h) that an edit takes away (stiffness 0), puts back or adds.
template <class Real>
struct EditedSpring {
    SpringEnds ends;
    /// If begin == end, this is the slot of the spring. If begin < end, a kernel searches for the slot in
    /// this range, in which springs ascend by `first` and each particle is `first` of at most one.
    std::size_t begin, end;
    SpringConstants<Real> constants;
    SpringRest<Real> off_lattice_rest;
    bool squared;  ///< `constants` has the square of the rest length; the kernel measures the length
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
/// The longest Argument in bytes. Every device and driver allows a kernel 4096 bytes of arguments in all, so
/// other arguments fit beside it.
inline constexpr std::size_t max_argument_bytes = 3840;
using ShortArgument = Argument<16>;
using LongArgument = Argument<max_argument_bytes / sizeof(ArgumentWord)>;

}  // namespace voxspring::layout
