// Makes the delta-compressed lists of kernels/delta.h on the host, without a device.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "backends/layout/blocks.h"
#include "backends/layout/neighbour_lists.h"
#include "backends/layout/particles.h"
#include "backends/layout/records/delta.h"
#include "backends/layout/records/edit.h"
#include "backends/limits.h"

namespace voxspring::layout {

/// One word per particle, with guard words before and after, which may be read in place of missing
/// neighbours.
Placement place_guarded(const Problem& problem);

/// Says where lattice neighbours are: a particle's index plus a delta is the index of a neighbour
/// (RowDeltas).
struct DeltaLists {
    std::vector<Slice> slices;  ///< OffLatticeLists sets the fields for springs beyond the lattice
    std::vector<RowDeltas> lists;
};
/// Makes the lists from the voxels and the spring groups in use. It does not matter which springs exist: cuts
/// and sutures of lattice springs change only masks.
DeltaLists compress_lists(const Problem& problem);

/// The lists of springs beyond the lattice, slice by slice (delta.h), while edits change them. If the slots
/// of a slice do not suffice, the slice gets a larger range at the end of the arrays.
template <class Real>
class OffLatticeLists {
public:
    OffLatticeLists() = default;
    /// Makes the lists, and sets off_lattice_begin and off_lattice_slots of `slices`. Rest lengths are those
    /// of listed_length().
    OffLatticeLists(const Problem& problem, const Placement& placement, Formulation formulation,
                    std::span<Slice> slices);

    /// The arrays of the springs, in columns. A column is one slot of all particles of a slice:
    /// slice_particles elements per array.
    std::span<const std::uint32_t> neighbour() const { return neighbour_; }
    std::span<const SpringConstants<Real>> constants() const { return constants_; }
    std::span<const SpringRest<Real>> off_lattice_rest() const { return off_lattice_rest_; }
    std::size_t columns() const { return neighbour_.size() / slice_particles; }
    bool empty() const { return neighbour_.empty(); }

    /// What an edit may have changed.
    struct Changes {
        std::vector<EditedSlice> slices;
        EditedLists<Real> columns;  ///< each column is stored as the list of one particle would be
    };
    Changes change(const Problem& edited, const SpringEdit& edit, std::span<Slice> slices);

private:
    /// Makes room for `slots` springs per particle of a slice.
    void extend(std::uint32_t number, Slice& slice, std::uint32_t slots);
    void put(std::size_t element, const Problem& problem, std::uint32_t particle, const Spring& spring);
    void clear(std::size_t element, std::uint32_t particle);
    std::size_t element(const Slice& slice, std::uint32_t particle, std::uint32_t slot) const {
        return (std::size_t(slice.off_lattice_begin) + slot) * slice_particles + particle % slice_particles;
    }

    Formulation formulation_{};
    std::size_t first_ = 0;  ///< index of the first particle's word
    std::size_t particles_ = 0;
    std::vector<std::uint32_t> neighbour_;
    std::vector<SpringConstants<Real>> constants_;
    std::vector<SpringRest<Real>> off_lattice_rest_;  ///< empty in formulations on positions
};

/// The kernel's first argument. Its pointers are null, as those of make_implicit_step().
template <class Real>
DeltaStep<Real> make_delta_step(const Problem& problem, const Placement& placement, Formulation formulation);

/// The least work of a step (bytes and operations). The lists that runs of particles share are few and do not
/// count.
template <class Real>
StepWork delta_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
