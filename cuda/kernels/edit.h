// The bodies of the kernels that write on the device what an edit changed: particles' bits, slots of their
// neighbours, rows of their lists, springs of the spring array.
#pragma once

#include <cfloat>

#include "backends/layout/records/edit.h"
#include "backends/layout/records/explicit.h"
#include "backends/physics/inverse_root.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {

/// measured_length(squared), or 0 if `squared` is too small, as in a slot without a spring: measured_length()
/// calls inverse_root(), which is defined for normal numbers only.
template <class Real>
VOXSPRING_HOST_DEVICE Real measured_or_zero(Real squared) {
    constexpr Real smallest = sizeof(Real) == sizeof(float) ? Real(FLT_MIN) : Real(DBL_MIN);
    return squared >= smallest ? measured_length(squared) : Real(0);
}

template <class Real>
VOXSPRING_HOST_DEVICE SpringConstants<Real> rest_measured(SpringConstants<Real> constants, bool squared) {
    if (squared) constants.rest_length = measured_or_zero(constants.rest_length);
    return constants;
}

template <class Real>
VOXSPRING_HOST_DEVICE void write_bits(ParticleRecord<Real>* words, EditedWord edited) {
    words[edited.word].bits = ParticleRecord<Real>::with(edited.bits);
}

/// Writes word n of an edit. The first `slots` words belong to ResidentStep::slot, the others are bits of
/// `words`.
template <class Real>
VOXSPRING_HOST_DEVICE void write_slot_or_bits(std::uint16_t* slot, std::size_t slots,
                                              ParticleRecord<Real>* words, const EditedWord* edited,
                                              std::size_t n) {
    if (n < slots) {
        slot[edited[n].word] = std::uint16_t(edited[n].bits);
    } else {
        write_bits(words, edited[n]);
    }
}

/// Writes slot n of the edited rows to the element of the lists that `shape` says.
template <class Real>
VOXSPRING_HOST_DEVICE void write_slot(const EditedRows<Real>& rows, std::size_t n, const ListShape& shape,
                                      std::uint32_t* neighbour, SpringConstants<Real>* constants,
                                      SpringRest<Real>* off_lattice_rest) {
    const std::size_t at = shape.at(rows.particle[n / shape.slots], std::uint32_t(n % shape.slots));
    neighbour[at] = rows.neighbour[n];
    if (rows.constants != nullptr) constants[at] = rest_measured(rows.constants[n], rows.squared);
    if (rows.off_lattice_rest != nullptr) off_lattice_rest[at] = rows.off_lattice_rest[n];
}

template <class Real>
VOXSPRING_HOST_DEVICE void write_spring(const EditedSpring<Real>& edited, SpringEnds* ends,
                                        SpringConstants<Real>* constants,
                                        SpringRest<Real>* off_lattice_rest) {
    std::size_t begin = edited.begin, end = edited.end;
    while (begin < end) {
        const std::size_t middle = begin + (end - begin) / 2;
        if (ends[middle].first < edited.ends.first) {
            begin = middle + 1;
        } else {
            end = middle;
        }
    }
    // A spring that was searched for (begin < end) keeps its ends.
    if (edited.begin == edited.end) ends[begin] = edited.ends;
    constants[begin] = rest_measured(edited.constants, edited.squared);
    if (off_lattice_rest != nullptr) off_lattice_rest[begin] = edited.off_lattice_rest;
}

}  // namespace voxspring::cuda
