#include "backends/layout/neighbour_lists.h"

#include <algorithm>

#include "backends/layout/particles.h"
#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"

namespace voxspring::layout {

namespace {

// The number of particles, signed because OpenMP's loops prefer that.
std::ptrdiff_t count_of(const Problem& problem) { return std::ptrdiff_t(problem.particle_count()); }

ListShape make_shape(std::size_t particles, std::uint32_t slots, ListLayout layout) {
    if (layout == ListLayout::concatenated)
        return {.particle_stride = slots, .slot_stride = 1, .slots = slots};
    return {.particle_stride = 1,
            // The entries of one slot, for all particles together, begin on a cache line.
            .slot_stride = ListRows::stride(std::uint32_t(particles)),
            .slots = slots};
}

template <class Real>
void start_lists(NeighbourLists<Real>& lists, const Problem& problem, std::uint32_t slots,
                 ListLayout layout) {
    lists.shape = make_shape(problem.particle_count(), slots, layout);
    lists.neighbour.resize(list_size(problem.particle_count(), slots, layout));
    lists.bits = state_bits(problem);
}

// Fills the unused slots `begin` to `end` (exclusive) of a list: in each the neighbour is the particle
// itself.
template <class Real>
void fill_unused(NeighbourLists<Real>& lists, std::uint32_t row, std::uint32_t particle, std::uint32_t begin,
                 std::uint32_t end, Formulation formulation) {
    for (std::uint32_t slot = begin; slot < end; ++slot)
        lists.neighbour[lists.shape.at(row, slot)] = entry_of(particle, NO_DIRECTION, formulation);
}

constexpr std::array<std::uint32_t, 3> group_masks = {FACE_BITS, EDGE_BITS, CORNER_BITS};
constexpr std::array<std::uint32_t, 3> group_slots = {6, 12, 8};

// The slot at which each group begins in a list, and the slot after the last group.
std::array<std::uint32_t, 4> group_slots_of(const Problem& problem) {
    std::array<std::uint32_t, 4> first{};
    for (std::size_t g = 0; g < 3; ++g)
        first[g + 1] = first[g] + ((problem.group_bits & group_masks[g]) != 0 ? group_slots[g] : 0);
    first[3] = std::max(first[3], 1U);
    return first;
}

}  // namespace

std::size_t list_size(std::size_t particles, std::uint32_t slots, ListLayout layout) {
    const ListShape shape = make_shape(particles, slots, layout);
    return layout == ListLayout::vertical ? std::size_t(shape.slot_stride) * slots : particles * slots;
}

std::uint32_t slots_by_groups(const Problem& problem) { return group_slots_of(problem)[3]; }

std::uint32_t slots_by_springs(const Problem& problem) {
    const std::vector<std::uint32_t> degree = degrees(problem);
    const std::uint32_t most = degree.empty() ? 0 : *std::max_element(degree.begin(), degree.end());
    return std::uint32_t(rounded_up(std::max(most, 1U), std::uint32_t(list_chunk)));
}

namespace {

// Fills list `row` with the springs of `particle`, which visit(add) lists by calling add(bit, neighbour).
template <class Real, class Visit>
void fill_by_groups(NeighbourLists<Real>& lists, std::uint32_t row, std::uint32_t particle,
                    const std::array<std::uint32_t, 4>& first, Formulation formulation, Visit visit) {
    std::array<std::uint32_t, 3> count{};
    visit([&](int bit, std::uint32_t neighbour) {
        const auto g = std::size_t(directions()[std::size_t(bit)].group);
        lists.neighbour[lists.shape.at(row, first[g] + count[g]++)] = entry_of(neighbour, bit, formulation);
    });
    for (std::size_t g = 0; g < 3; ++g) {
        lists.bits[row] |= count[g] << GroupCounters::shift(int(g));
        fill_unused(lists, row, particle, first[g] + count[g], first[g + 1], formulation);
    }
}

// Appends a spring to list `row`, and counts it in the list's bits. Returns the index of the spring's
// element.
template <class Real>
std::size_t append(NeighbourLists<Real>& lists, std::uint32_t row, std::uint32_t entry, double stiffness,
                   Real rest_length) {
    const std::size_t at = lists.shape.at(row, lists.bits[row] & list_count_bits);
    lists.neighbour[at] = entry;
    lists.constants[at] = {Real(stiffness), rest_length};
    ++lists.bits[row];
    return at;
}

// Appends a spring beyond the lattice to the list `row` of `particle`.
template <class Real>
void append_off_lattice(NeighbourLists<Real>& lists, const Problem& problem, std::uint32_t row,
                        std::uint32_t particle, const Spring& spring, Formulation formulation) {
    const std::uint32_t neighbour = spring.first == particle ? spring.second : spring.first;
    const std::size_t at = append(lists, row, entry_of(neighbour, -1, formulation), spring.stiffness,
                                  listed_length<Real>(spring, formulation));
    if (!on_positions(formulation))
        lists.off_lattice_rest[at] =
            off_lattice_rest_of<Real>(problem, particle, neighbour, spring.rest_length);
}

template <class Real>
std::array<Real, neighbour_count> listed_lengths(const Problem& problem, Formulation formulation) {
    std::array<Real, neighbour_count> lengths{};
    for (const Direction& direction : directions())
        lengths[std::size_t(direction.bit)] = listed_length<Real>(problem, direction, formulation);
    return lengths;
}

// Makes room for the arrays that list_by_springs() fills besides `neighbour`.
template <class Real>
void start_constants(NeighbourLists<Real>& lists, const Problem& problem, Formulation formulation) {
    lists.constants.resize(lists.neighbour.size(), {0, 0});
    if (!problem.springs.empty() && !on_positions(formulation))
        lists.off_lattice_rest.resize(lists.neighbour.size());
}

template <class Real>
EditedLists<Real> start_edited(const SpringEdit& edit, std::uint32_t slots) {
    EditedLists<Real> edited;
    edited.lists.shape = make_shape(edit.touched.size(), slots, ListLayout::concatenated);
    edited.lists.neighbour.resize(edit.touched.size() * slots);
    for (const SpringEdit::Touched& touched : edit.touched) {
        edited.particle.push_back(touched.particle);
        edited.lists.bits.push_back(touched.mask & (ACTIVE_BIT | PINNED_BIT));
    }
    return edited;
}

}  // namespace

template <class Real>
NeighbourLists<Real> list_by_groups(const Problem& problem, ListLayout layout, Formulation formulation) {
    NeighbourLists<Real> lists;
    start_lists(lists, problem, slots_by_groups(problem), layout);
    const auto first = group_slots_of(problem);
    std::copy_n(first.begin(), 3, lists.first_slot.begin());
    const LatticeSprings springs(problem);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::uint32_t(n);
        fill_by_groups(lists, i, i, first, formulation, [&](auto add) {
            springs.all_of(i, [&](std::uint32_t j, const Direction& direction) { add(direction.bit, j); });
        });
    }
    return lists;
}

template <class Real>
NeighbourLists<Real> list_by_springs(const Problem& problem, ListLayout layout, Formulation formulation) {
    NeighbourLists<Real> lists;
    start_lists(lists, problem, slots_by_springs(problem), layout);
    start_constants(lists, problem, formulation);
    const auto lengths = listed_lengths<Real>(problem, formulation);
    const LatticeSprings springs(problem);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::uint32_t(n);
        springs.all_of(i, [&](std::uint32_t j, const Direction& direction) {
            append(lists, i, entry_of(j, direction.bit, formulation),
                   problem.spring_stiffness(i, j, direction), lengths[std::size_t(direction.bit)]);
        });
    }
    for (const Spring& spring : problem.springs) {
        append_off_lattice(lists, problem, spring.first, spring.first, spring, formulation);
        append_off_lattice(lists, problem, spring.second, spring.second, spring, formulation);
    }
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::uint32_t(n);
        fill_unused(lists, i, i, lists.bits[i] & list_count_bits, lists.shape.slots, formulation);
    }
    return lists;
}

template <class Real>
void put_rows_ahead(NeighbourLists<Real>& lists) {
    const bool secondary = !lists.constants.empty();
    const auto particles = std::uint32_t(lists.bits.size());
    const std::size_t stride = ListRows::stride(particles);
    std::vector<std::uint32_t> rows(ListRows::size(particles, secondary));
    for (std::uint32_t i = 0; i < particles; ++i) {
        rows[i] = std::uint32_t(lists.shape.at(i, 0));
        for (std::uint32_t row = 1; row < ListRows::count(secondary); ++row)
            rows[row * stride + i] = secondary ? lists.bits[i] & list_count_bits
                                               : GroupCounters::count(lists.bits[i], int(row) - 1);
    }
    lists.neighbour.insert(lists.neighbour.begin(), rows.begin(), rows.end());
}

std::uint32_t longest_list(const SpringEdit& edit) {
    std::uint32_t longest = 0;
    for (const SpringEdit::Touched& touched : edit.touched)
        longest = std::max(longest, touched.end - touched.begin);
    return longest;
}

template <class Real>
EditedLists<Real> edited_by_groups(const Problem& problem, const SpringEdit& edit, std::uint32_t slots,
                                   Formulation formulation) {
    EditedLists<Real> edited = start_edited<Real>(edit, slots);
    const auto first = group_slots_of(problem);
    for (std::uint32_t row = 0; row < edit.touched.size(); ++row) {
        fill_by_groups(edited.lists, row, edit.touched[row].particle, first, formulation, [&](auto add) {
            for (const ListedSpring& s : edit.springs_of(edit.touched[row])) add(s.bit, s.neighbour);
        });
    }
    return edited;
}

template <class Real>
EditedLists<Real> edited_by_springs(const Problem& problem, const SpringEdit& edit, std::uint32_t slots,
                                    Formulation formulation) {
    EditedLists<Real> edited = start_edited<Real>(edit, slots);
    start_constants(edited.lists, problem, formulation);
    const auto lengths = listed_lengths<Real>(problem, formulation);
    for (std::uint32_t row = 0; row < edit.touched.size(); ++row) {
        const std::uint32_t particle = edit.touched[row].particle;
        for (const ListedSpring& s : edit.springs_of(edit.touched[row])) {
            if (s.bit < 0) {
                append_off_lattice(edited.lists, problem, row, particle,
                                   Spring{particle, s.neighbour, s.stiffness, s.rest_length}, formulation);
            } else {
                append(edited.lists, row, entry_of(s.neighbour, s.bit, formulation), s.stiffness,
                       lengths[std::size_t(s.bit)]);
            }
        }
        fill_unused(edited.lists, row, particle, edited.lists.bits[row] & list_count_bits, slots,
                    formulation);
    }
    return edited;
}

template <class Real>
ExplicitStep<Real> make_explicit_step(const Problem& problem, const NeighbourLists<Real>& lists,
                                      Formulation formulation) {
    ExplicitStep<Real> step{};
    step.particles = int(problem.particle_count());
    step.group_bits = problem.group_bits;
    step.shape = lists.shape;
    for (std::size_t g = 0; g < 3; ++g) {
        step.first_slot[g] = lists.first_slot[g];
        step.stiffness[g] = Real(problem.group_stiffness[g]);
    }
    // Any direction of a group gives the group's rest length. Only lists without constants per spring use
    // these lengths, and grouped_list_refusal() has checked that all directions of a group have the same one.
    for (const Direction& direction : directions())
        step.rest_length[std::size_t(direction.group)] = listed_length<Real>(problem, direction, formulation);
    std::ranges::copy(rest_by_code<Real>(problem), step.rest);
    step.motion = make_motion<Real>(problem);
    return step;
}

#define FOR_PRECISION(Real)                                                                        \
    template NeighbourLists<Real> list_by_groups(const Problem&, ListLayout, Formulation);         \
    template NeighbourLists<Real> list_by_springs(const Problem&, ListLayout, Formulation);        \
    template void put_rows_ahead(NeighbourLists<Real>&);                                           \
    template EditedLists<Real> edited_by_groups(const Problem&, const SpringEdit&, std::uint32_t,  \
                                                Formulation);                                      \
    template EditedLists<Real> edited_by_springs(const Problem&, const SpringEdit&, std::uint32_t, \
                                                 Formulation);                                     \
    template ExplicitStep<Real> make_explicit_step(const Problem&, const NeighbourLists<Real>&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
