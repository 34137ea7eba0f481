// Explicit addressing: particles without their grid, and a list of each one's neighbours. The body of the
// kernels, with the fetch as its parameter: `current.at(i, 0)` is particle i, `current.entry(p)` what a list
// holds at p.
//
// Every list has the same number of slots, and an unused slot holds the particle itself, whose pull on itself
// is zero. So lists are read in whole chunks, ahead of the counters that say where they end.
#pragma once

#include "cuda/kernels/motion.h"

namespace voxspring::cuda {

/// Where slot s of particle i is: element i * particle_stride + s * slot_stride. `vertical` lists (Figure 6
/// b) have one slot of all particles together, `concatenated` ones (Figure 6 a) all slots of one particle.
struct ListShape {
    std::uint32_t particle_stride = 0;
    std::uint32_t slot_stride = 0;
    std::uint32_t slots = 0;  ///< a particle
    VOXSPRING_HOST_DEVICE std::size_t at(std::uint32_t particle, std::uint32_t slot) const {
        return std::size_t(particle) * particle_stride + std::size_t(slot) * slot_stride;
    }
    bool operator==(const ListShape&) const = default;
};

/// Everything a step needs besides positions.
template <class Real>
struct ExplicitStep {
    int particles;
    ListShape shape;
    const std::uint32_t* neighbour;
    const SpringConstants<Real>* constants;  ///< the secondary list; null where groups suffice
    std::uint32_t first_slot[3];             ///< without: where each group begins in a list,
    Real stiffness[3], rest_length[3];       ///< and what its springs have in common
    Motion<Real> motion;
    bool operator==(const ExplicitStep&) const = default;
};

/// With a secondary list a particle's bits count its springs.
inline constexpr std::uint32_t list_count_bits = NEIGHBOUR_BITS;

/// Without one they count the springs of each group.
struct GroupCounters {
    static VOXSPRING_HOST_DEVICE std::uint32_t shift(int group) {
        return group == 0 ? 0 : group == 1 ? 3 : 7;
    }
    static VOXSPRING_HOST_DEVICE std::uint32_t count(std::uint32_t bits, int group) {
        return bits >> shift(group) & (group == 0 ? 7U : 15U);
    }
};

/// Slots read at a time; of groups in general, of which one has 8.
inline constexpr int list_chunk = 6;
inline constexpr int short_chunk = 2;

/// Adds the pull of `count` springs to `sum`.
template <int count, class Real, class Current>
VOXSPRING_HOST_DEVICE void add_chunk(Vector<Real>& sum, Vector<Real> position, const std::uint32_t* neighbour,
                                     Real rest_length, Real shortest_squared, const Current& current) {
    Vector<Real> other[count];
    for (int s = 0; s < count; ++s) other[s] = current.at(int(neighbour[s]), 0).position;
    for (int s = 0; s < count; ++s) {
        const Vector<Real> offset = position - other[s];
        sum = sum + offset * unit_force_density(offset, rest_length, shortest_squared);
    }
}

/// Steps particle i by its lists and counters a spring group. `face_and_edge`: the scene's groups are the
/// paper's two; otherwise any, tested at run time.
template <bool face_and_edge, class Real, class Current>
VOXSPRING_HOST_DEVICE void step_by_groups(const ExplicitStep<Real>& step, int i, const Current& current,
                                          Word<Real>* previous) {
    if (i >= step.particles) return;
    const std::uint32_t* list = step.neighbour + step.shape.at(std::uint32_t(i), 0);
    // Reads `count` slots of a group, the first of which is `from`.
    const auto read = [&](std::uint32_t* neighbour, std::uint32_t from, int count) {
        for (int s = 0; s < count; ++s)
            neighbour[s] =
                current.entry(list + std::size_t(from + std::uint32_t(s)) * step.shape.slot_stride);
    };
    const Real shortest = step.motion.shortest_squared;
    Vector<Real> force{0, 0, 0};
    Vector<Real> group{0, 0, 0};
    const Particle<Real> self = current.at(i, 0);
    const Vector<Real> before = load_past_l1(previous + i).position;
    if constexpr (face_and_edge) {
        // All indices and the first chunk of each group without a look at the counters: what a fetch does not
        // wait for, a step does not wait for either.
        std::uint32_t face[6], edge[12];
        read(face, 0, 6);
        read(edge, 6, 12);
        add_chunk<list_chunk>(group, self.position, face, step.rest_length[0], shortest, current);
        force = group * step.stiffness[0];
        group = {0, 0, 0};
        add_chunk<list_chunk>(group, self.position, edge, step.rest_length[1], shortest, current);
        if (GroupCounters::count(self.bits, 1) > list_chunk)
            add_chunk<list_chunk>(group, self.position, edge + list_chunk, step.rest_length[1], shortest,
                                  current);
        force = force + group * step.stiffness[1];
    } else {
        for (int g = 0; g < 3; ++g) {
            const std::uint32_t count = GroupCounters::count(self.bits, g);
            for (std::uint32_t s = 0; s < count; s += short_chunk) {
                std::uint32_t neighbour[short_chunk];
                read(neighbour, step.first_slot[g] + s, short_chunk);
                add_chunk<short_chunk>(group, self.position, neighbour, step.rest_length[g], shortest,
                                       current);
            }
            force = force + group * step.stiffness[g];
            group = {0, 0, 0};
        }
    }
    store(previous + i, moved(step.motion, i, self, before, force));
}

/// Steps particle i by its list and the secondary list: springs of any stiffness and rest length.
template <class Real, class Current>
VOXSPRING_HOST_DEVICE void step_by_springs(const ExplicitStep<Real>& step, int i, const Current& current,
                                           Word<Real>* previous) {
    if (i >= step.particles) return;
    const Particle<Real> self = current.at(i, 0);
    const Vector<Real> before = load_past_l1(previous + i).position;
    Vector<Real> force{0, 0, 0};
    const std::uint32_t count = self.bits & list_count_bits;
    for (std::uint32_t first = 0; first < count; first += list_chunk) {
        const std::size_t at = step.shape.at(std::uint32_t(i), first);
        std::uint32_t neighbour[list_chunk];
        SpringConstants<Real> constants[list_chunk];
        Vector<Real> other[list_chunk];
        for (int s = 0; s < list_chunk; ++s)
            neighbour[s] = current.entry(step.neighbour + at + std::size_t(s) * step.shape.slot_stride);
        for (int s = 0; s < list_chunk; ++s)
            constants[s] = current.entry(step.constants + at + std::size_t(s) * step.shape.slot_stride);
        for (int s = 0; s < list_chunk; ++s) other[s] = current.at(int(neighbour[s]), 0).position;
        for (int s = 0; s < list_chunk; ++s) {
            const Vector<Real> offset = self.position - other[s];
            const Real scale =
                unit_force_density(offset, constants[s].rest_length, step.motion.shortest_squared);
            force = force + offset * (scale * constants[s].stiffness);
        }
    }
    store(previous + i, moved(step.motion, i, self, before, force));
}

}  // namespace voxspring::cuda
