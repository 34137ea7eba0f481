// Makes neighbour lists in the layout of records/explicit.h, and the new lists that an edit needs.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "backends/layout/records/explicit.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// Figure 6 of the paper: all particles' entries of one slot together (b), or all entries of a particle (a).
enum class ListLayout : std::uint8_t { vertical, concatenated };

/// The neighbour lists of all particles (records/explicit.h).
template <class Real>
struct NeighbourLists {
    ListShape shape;
    std::vector<std::uint32_t> neighbour;
    /// The stiffness and rest length of each entry of `neighbour` (the secondary list). Empty in lists with
    /// constants per group (list_by_groups()).
    std::vector<SpringConstants<Real>> constants;
    /// How springs beyond the lattice lie at rest, by element of `neighbour`. Empty in formulations on
    /// positions, or if there are no such springs.
    std::vector<SpringRest<Real>> off_lattice_rest;
    std::vector<std::uint32_t> bits;            ///< one per particle: spring counters, active and pinned bits
    std::array<std::uint32_t, 3> first_slot{};  ///< slot at which each group begins, if `constants` is empty
};

/// The number of elements of the lists of `particles` particles with `slots` slots per particle.
std::size_t list_size(std::size_t particles, std::uint32_t slots, ListLayout layout);
/// The numbers of slots per particle in the lists that list_by_groups() and list_by_springs() make.
std::uint32_t slots_by_groups(const Problem& problem);
std::uint32_t slots_by_springs(const Problem& problem);

/// Makes lists with a counter per particle and spring group, and with constants per group.
/// grouped_list_refusal() must be empty.
template <class Real>
NeighbourLists<Real> list_by_groups(const Problem& problem, ListLayout layout, Formulation formulation);
/// Makes lists with one counter per particle, and a stiffness and rest length per spring, for any problem. A
/// particle's lattice springs come first, in the order of directions(), then its springs beyond the lattice
/// in the order of Problem::springs.
template <class Real>
NeighbourLists<Real> list_by_springs(const Problem& problem, ListLayout layout, Formulation formulation);

/// Puts the rows that ListRows describes before the entries of `lists`, which must all have been filled in.
template <class Real>
void put_rows_ahead(NeighbourLists<Real>& lists);

/// New lists of the particles that an edit touched.
template <class Real>
struct EditedLists {
    std::vector<std::uint32_t> particle;
    NeighbourLists<Real> lists;  ///< concatenated; list n is that of particle[n]
};
/// The most springs that a touched particle has.
std::uint32_t longest_list(const SpringEdit& edit);
/// Lists of the touched particles only, as list_by_groups() and list_by_springs() would make them, with
/// `slots` slots per particle.
template <class Real>
EditedLists<Real> edited_by_groups(const Problem& edited, const SpringEdit& edit, std::uint32_t slots,
                                   Formulation formulation);
template <class Real>
EditedLists<Real> edited_by_springs(const Problem& edited, const SpringEdit& edit, std::uint32_t slots,
                                    Formulation formulation);

/// Makes the kernel's argument, with rest lengths as listed_length() gives them. Its pointers are null: the
/// caller sets them to arrays on the device.
template <class Real>
ExplicitStep<Real> make_explicit_step(const Problem& problem, const NeighbourLists<Real>& lists,
                                      Formulation formulation);

}  // namespace voxspring::layout
