// Explicit addressing: particles without their grid, each with a list of its neighbours. The bodies of the
// kernels take the way of reading as a parameter: `current.point(i, 0)` is particle i, and `current.entry(p)`
// is the entry of a list at p.
//
// Every list has the same number of slots. An unused slot holds the particle itself, whose pull on itself is
// zero. So lists can be read in whole chunks, before the counters that say where lists end have been read.
#pragma once

#include "backends/layout/records/explicit.h"
#include "cuda/kernels/motion.h"

namespace voxspring::cuda {

/// How many slots step_by_groups() reads together, unless it is compiled for exactly the face and edge
/// springs. The number divides the size of every group: 6, 12 and 8.
inline constexpr int short_chunk = 2;

/// The index of the neighbour that a list entry names.
template <class Terms>
VOXSPRING_HOST_DEVICE int listed_index(std::uint32_t entry) {
    return int(Terms::positions ? entry : entry & LISTED_INDEX);
}
/// How the spring of a list entry lies at rest, by the entry's direction code. Not used on positions.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE SpringRest<Real> listed_rest(const SpringRest<Real>* rest, std::uint32_t entry) {
    if constexpr (Terms::positions) {
        return {};
    } else {
        return rest[entry >> LISTED_INDEX_BITS];
    }
}

/// Adds to `sum` the pulls, at stiffness 1, of the `count` springs in `entry`.
template <class Terms, int count, class Real, class Current>
VOXSPRING_HOST_DEVICE void add_chunk(Vector<Real>& sum, const Point<Real, Terms::split>& point,
                                     const std::uint32_t* entry, Real rest_length,
                                     const ExplicitStep<Real>& step, const Current& current) {
    Point<Real, Terms::split> other[count];
    for (int s = 0; s < count; ++s) other[s] = current.point(listed_index<Terms>(entry[s]), 0);
    for (int s = 0; s < count; ++s) {
        const Pull<Real> pull = unit_pull<Terms>(point - other[s], listed_rest<Terms>(step.rest, entry[s]),
                                                 rest_length, step.motion.shortest_squared);
        sum = fused(pull.offset, pull.density, sum);
    }
}

/// Steps particle i with its list. One counter per spring group says how many slots of the list are in use.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE void step_by_groups(const ExplicitStep<Real>& step, int i, const Current& current,
                                          const Output<Real>& output) {
    if (i >= step.particles) return;
    const std::uint32_t* list = step.neighbour + step.shape.at(std::uint32_t(i), 0);
    // Reads `count` slots of the list from slot `from` on.
    const auto read = [&](std::uint32_t* entry, std::uint32_t from, int count) {
        for (int s = 0; s < count; ++s)
            entry[s] = current.entry(list + std::size_t(from + std::uint32_t(s)) * step.shape.slot_stride);
    };
    Vector<Real> force{0, 0, 0};
    Vector<Real> group{0, 0, 0};
    const Self<Real, Terms::split> self = current.self(i);
    const PreviousOrVelocity<Real> before = load_before<Terms>(output, i);
    if constexpr (Terms::groups == (FACE_BITS | EDGE_BITS)) {
        // All indices and the first chunk of each group are fetched before the counters are known, so that
        // the step does not wait for the counters first.
        std::uint32_t face[6], edge[12];
        read(face, 0, 6);
        read(edge, 6, 12);
        add_chunk<Terms, list_chunk>(group, self.point, face, step.rest_length[0], step, current);
        force = group * step.stiffness[0];
        group = {0, 0, 0};
        add_chunk<Terms, list_chunk>(group, self.point, edge, step.rest_length[1], step, current);
        if (GroupCounters::count(self.bits, 1) > list_chunk)
            add_chunk<Terms, list_chunk>(group, self.point, edge + list_chunk, step.rest_length[1], step,
                                         current);
        force = force + group * step.stiffness[1];
    } else {
        for (int g = 0; g < 3; ++g) {
            const std::uint32_t count = GroupCounters::count(self.bits, g);
            for (std::uint32_t s = 0; s < count; s += short_chunk) {
                std::uint32_t entry[short_chunk];
                read(entry, step.first_slot[g] + s, short_chunk);
                add_chunk<Terms, short_chunk>(group, self.point, entry, step.rest_length[g], step, current);
            }
            force = force + group * step.stiffness[g];
            group = {0, 0, 0};
        }
    }
    integrate_and_store<Terms>(step.motion, output, i, self, before, force);
}

/// Steps particle i with its list and the secondary list, which holds the stiffness and rest length of each
/// spring.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE void step_by_springs(const ExplicitStep<Real>& step, int i, const Current& current,
                                           const Output<Real>& output) {
    if (i >= step.particles) return;
    const Self<Real, Terms::split> self = current.self(i);
    const PreviousOrVelocity<Real> before = load_before<Terms>(output, i);
    Vector<Real> force{0, 0, 0};
    const std::uint32_t count = self.bits & list_count_bits;
    for (std::uint32_t first = 0; first < count; first += list_chunk) {
        const std::size_t at = step.shape.at(std::uint32_t(i), first);
        std::uint32_t entry[list_chunk];
        SpringConstants<Real> constants[list_chunk];
        Point<Real, Terms::split> other[list_chunk];
        for (int s = 0; s < list_chunk; ++s)
            entry[s] = current.entry(step.neighbour + at + std::size_t(s) * step.shape.slot_stride);
        for (int s = 0; s < list_chunk; ++s)
            constants[s] = current.entry(step.constants + at + std::size_t(s) * step.shape.slot_stride);
        for (int s = 0; s < list_chunk; ++s) other[s] = current.point(listed_index<Terms>(entry[s]), 0);
        for (int s = 0; s < list_chunk; ++s) {
            SpringRest<Real> rest = listed_rest<Terms>(step.rest, entry[s]);
            if (Terms::template has<term_off_lattice_rests>(step.off_lattice_rest != nullptr) &&
                entry[s] >> LISTED_INDEX_BITS == OWN_DIRECTION)
                rest = step.off_lattice_rest[at + std::size_t(s) * step.shape.slot_stride];
            const Pull<Real> pull = unit_pull<Terms>(self.point - other[s], rest, constants[s].rest_length,
                                                     step.motion.shortest_squared);
            force = fused(pull.offset, pull.density * constants[s].stiffness, force);
        }
    }
    integrate_and_store<Terms>(step.motion, output, i, self, before, force);
}

/// Steps particle i with a list as the paper had it: the rows of ListRows say where the list begins and how
/// many entries it has, and entries are read one by one. Forces are added in the same order as in
/// step_by_groups() and step_by_springs().
template <class Terms, bool secondary, class Real, class Current>
VOXSPRING_HOST_DEVICE void step_by_rows(const ExplicitStep<Real>& step, int i, const Current& current,
                                        const Output<Real>& output) {
    if (i >= step.particles) return;
    const std::size_t stride = ListRows::stride(std::uint32_t(step.particles));
    const std::uint32_t* const row = step.neighbour - stride * ListRows::count(secondary) + i;
    const std::size_t begin = current.entry(row);
    const Self<Real, Terms::split> self = current.self(i);
    const PreviousOrVelocity<Real> before = load_before<Terms>(output, i);
    const auto pull_of = [&](std::size_t at, Real rest_length) {
        const std::uint32_t entry = current.entry(step.neighbour + at);
        SpringRest<Real> rest = listed_rest<Terms>(step.rest, entry);
        if (secondary && Terms::template has<term_off_lattice_rests>(step.off_lattice_rest != nullptr) &&
            entry >> LISTED_INDEX_BITS == OWN_DIRECTION)
            rest = step.off_lattice_rest[at];
        const auto other = current.point(listed_index<Terms>(entry), 0);
        return unit_pull<Terms>(self.point - other, rest, rest_length, step.motion.shortest_squared);
    };
    Vector<Real> force{0, 0, 0};
    if constexpr (secondary) {
        const std::uint32_t count = current.entry(row + stride);
        for (std::uint32_t s = 0; s < count; ++s) {
            const std::size_t at = begin + std::size_t(s) * step.shape.slot_stride;
            const SpringConstants<Real> constants = current.entry(step.constants + at);
            const Pull<Real> pull = pull_of(at, constants.rest_length);
            force = fused(pull.offset, pull.density * constants.stiffness, force);
        }
    } else {
        for (int g = 0; g < 3; ++g) {
            if ((Terms::groups & (g == 0 ? FACE_BITS : g == 1 ? EDGE_BITS : CORNER_BITS)) == 0) continue;
            const std::uint32_t count = current.entry(row + stride * std::size_t(1 + g));
            Vector<Real> group{0, 0, 0};
            for (std::uint32_t s = 0; s < count; ++s) {
                const std::size_t slot = step.first_slot[g] + s;
                const Pull<Real> pull = pull_of(begin + slot * step.shape.slot_stride, step.rest_length[g]);
                group = fused(pull.offset, pull.density, group);
            }
            force = force + group * step.stiffness[g];
        }
    }
    integrate_and_store<Terms>(step.motion, output, i, self, before, force);
}

}  // namespace voxspring::cuda
