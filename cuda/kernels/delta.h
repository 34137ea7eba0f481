// Explicit addressing by delta-compressed lists. This is the body of the kernel; cuda/README.md draws the
// layout.
//
// Particles are in canonical order, without their grid. The neighbours of a particle lie in nine rows of
// voxels, and the particles of each row follow one another in canonical order as well. So a list says how
// many particles lie between the particle and its place in each of the other eight rows, and the particle's
// mask says to which neighbours it has a spring. The deltas seldom change along a row: all particles of a run
// share one list, and one bit per particle says whether the next list begins with it. Springs beyond the
// lattice are in separate lists, one per slice.
#pragma once

#ifndef __CUDACC_RTC__
#include <bit>
#endif

#include "backends/layout/records/delta.h"
#include "cuda/kernels/implicit.h"

namespace voxspring::cuda {

/// Counts the bits that are set among bits 0 to `lane`, inclusive.
VOXSPRING_HOST_DEVICE inline int rank(std::uint32_t bits, std::uint32_t lane) {
    const std::uint32_t counted = bits & 0xFFFFFFFFU >> (31U - lane);
#ifdef __CUDA_ARCH__
    return __popc(counted);
#else
    return std::popcount(counted);
#endif
}

/// A particle's list in registers. For each row: the offset, in words, from the particle's word to that of
/// its neighbour in the middle of the row (dx = 0).
struct ListedDeltas {
    FourDeltas near, far;
    /// The offset to the middle of row (dy, dz).
    VOXSPRING_HOST_DEVICE int operator()(int dy, int dz) const {
        const int row = row_number(dy, dz);
        return row == row_count ? 0 : row < 4 ? near.row[row] : far.row[row - 4];
    }
};

/// The list of the particle that is number `lane` of its slice.
template <class Real>
VOXSPRING_HOST_DEVICE const RowDeltas* list_of(const DeltaStep<Real>& step, const Slice& slice,
                                               std::uint32_t lane) {
    return step.lists + slice.list + rank(slice.starts, lane);
}
template <class Current>
VOXSPRING_HOST_DEVICE ListedDeltas read_deltas(const RowDeltas* list, const Current& current) {
    return {current.entry(&list->rows[0]), current.entry(&list->rows[1])};
}

/// Whether the particles of all threads that run this together have all neighbours, with no gap among them.
/// `bits` is this thread's mask. Some spring groups join a particle to both sides (dx = -1 and 1) of a row
/// but not to its middle. With such groups a particle that has all neighbours may still have a gap, so the
/// result is false. It is also false without term_full_stencil.
template <class Terms>
VOXSPRING_HOST_DEVICE bool all_full_stencils_without_gaps(std::uint32_t bits) {
    constexpr bool faces = (Terms::groups & FACE_BITS) != 0, edges = (Terms::groups & EDGE_BITS) != 0,
                   corners = (Terms::groups & CORNER_BITS) != 0;
    if constexpr ((edges && !faces) || (corners && !edges)) {
        return false;
    } else {
        return all_full_stencils<Terms>(bits);
    }
}

/// The force of the lattice springs of the particle of word `index`, whose list is `list`.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE Vector<Real> listed_force(const DeltaStep<Real>& step, const RowDeltas* list, int index,
                                                const Self<Real, Terms::split>& self,
                                                const Current& current) {
    const ListedDeltas delta = read_deltas(list, current);
    if (all_full_stencils_without_gaps<Terms>(self.bits)) {
        return implicit_force<Terms, true>(
            step, self, [&](int dx, int dy, int dz) { return current.point(index + delta(dy, dz), dx); },
            [&](int dx, int dy, int dz) { return step.compliance[index + delta(dy, dz) + dx]; });
    }
    const std::uint32_t gaps = current.entry(&list->gaps);
    // The word from which `dx` counts. If the middle of a row is missing (a gap), its neighbour at dx = 1 is
    // one word nearer.
    const auto row = [&](int dx, int dy, int dz) {
        const int number = row_number(dy, dz);
        return index + delta(dy, dz) - (dx > 0 && number < row_count ? int(gaps >> number & 1U) : 0);
    };
    return implicit_force<Terms, false>(
        step, self, [&](int dx, int dy, int dz) { return current.point(row(dx, dy, dz), dx); },
        [&](int dx, int dy, int dz) { return step.compliance[row(dx, dy, dz) + dx]; });
}

/// Adds the forces of the particle's off-lattice springs (Problem::springs) to `force`. Returns the sum.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE Vector<Real> with_off_lattice_springs(Vector<Real> force, const DeltaStep<Real>& step,
                                                            const Slice& slice, std::uint32_t lane,
                                                            const Self<Real, Terms::split>& self,
                                                            const Current& current) {
    for (std::uint32_t slot = 0; slot < slice.off_lattice_slots; slot += off_lattice_chunk) {
        const std::size_t at = (std::size_t(slice.off_lattice_begin) + slot) * slice_particles + lane;
        Point<Real, Terms::split> other[off_lattice_chunk];
        for (int s = 0; s < off_lattice_chunk; ++s)
            other[s] =
                current.point(int(current.entry(step.off_lattice_neighbour + at + s * slice_particles)), 0);
        for (int s = 0; s < off_lattice_chunk; ++s) {
            const std::size_t element = at + std::size_t(s) * slice_particles;
            const SpringConstants<Real> constants = current.entry(step.off_lattice_constants + element);
            SpringRest<Real> rest{};
            if constexpr (!Terms::positions) rest = step.off_lattice_rest[element];
            const Pull<Real> pull = unit_pull<Terms>(self.point - other[s], rest, constants.rest_length,
                                                     step.motion.shortest_squared);
            force = fused(pull.offset, pull.density * constants.stiffness, force);
        }
    }
    return force;
}

template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE void step_by_deltas(const DeltaStep<Real>& step, int i, const Current& current,
                                          const Output<Real>& output) {
    if (i >= step.particles) return;
    const auto lane = std::uint32_t(i % slice_particles);
    const int index = step.first + i;
    const Slice slice = current.entry(step.slices + i / slice_particles);
    const Self<Real, Terms::split> self = current.self(index);
    const PreviousOrVelocity<Real> before = load_before<Terms>(output, index);
    Vector<Real> force = listed_force<Terms>(step, list_of(step, slice, lane), index, self, current);
    if (Terms::template has<term_off_lattice_springs>(step.off_lattice_neighbour != nullptr))
        force = with_off_lattice_springs<Terms>(force, step, slice, lane, self, current);
    integrate_and_store<Terms>(step.motion, output, index, self, before, force);
}

}  // namespace voxspring::cuda
