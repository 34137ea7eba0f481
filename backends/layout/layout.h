// How a problem lies in device memory, built on the host and without a device: word arrays, neighbour lists,
// blocks, spring arrays.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "backends/layout/records/edit.h"
#include "backends/layout/records/explicit.h"
#include "backends/layout/records/implicit.h"
#include "backends/layout/records/scatter.h"
#include "backends/layout/records/terms.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::cuda {

/// Indices of words are of type int.
inline constexpr std::size_t most_words = 0x7FFFFFFF;

// --- Words --------------------------------------------------------------------------------------------

/// Which word of an array a particle has.
struct Placement {
    std::size_t words = 0;
    std::size_t first = 0;
    const std::vector<std::uint32_t>* voxel = nullptr;  ///< null: particle i is word first + i
    std::size_t at(std::size_t particle) const {
        return first + (voxel == nullptr ? particle : (*voxel)[particle]);
    }
};

/// One word a voxel, with enough guard words on either side that the 26 neighbours of every voxel are words.
Placement place_on_grid(const Lattice& lattice);
/// One word a particle.
Placement place_compact(const Problem& problem);

/// The state of every particle in its word, as a formulation has it (formulation.h); words without a particle
/// are zero, and what a formulation has no use for is empty.
template <class Real>
struct PackedState {
    std::vector<Word<Real>> current;      ///< x or u
    std::vector<Word<Real>> previous;     ///< x or u at t - dt
    std::vector<Word<Real>> current_low;  ///< low parts of u
    /// v and its low parts: x of all words, then y, then z, increment_pitch() apart.
    std::vector<Real> increment, increment_low;
};
/// Axes of increments begin on a cache line.
std::size_t increment_pitch(const Placement& placement);
/// `bits`: one a particle.
template <class Real>
PackedState<Real> pack(const Problem& problem, const State& state, const Placement& placement,
                       std::span<const std::uint32_t> bits, Formulation formulation);
template <class Real>
State unpack(const Problem& problem, const PackedState<Real>& packed, const Placement& placement,
             Formulation formulation);

/// Problem::load, one a word; empty if the problem has none.
template <class Real>
std::vector<Vector<Real>> pack_load(const Problem& problem, const Placement& placement);
/// 1 / mass, one a word; empty if there is one material.
template <class Real>
std::vector<Real> pack_inverse_masses(const Problem& problem, const Placement& placement);
/// 1 / stiffness, one a word; empty if there is one material.
template <class Real>
std::vector<Real> pack_compliance(const Problem& problem, const Placement& placement);

/// `load` and `inverse_masses` are the caller's to point at device memory.
template <class Real>
Motion<Real> make_motion(const Problem& problem);

// --- Springs ------------------------------------------------------------------------------------------

/// The square of a lattice direction's rest length: that of its offset where the lattice is stress-free, so
/// that it is the very number a kernel computes at rest, and not the square of a rounded root.
double squared_rest_length(const Problem& problem, const Direction& direction);

/// A rest length as unit_pull() takes it: by increments as it is, else its square, to be measured. The square
/// is what a kernel finds at rest, so that the force there is zero to the bit.
template <class Real>
Real listed_length(const Problem& problem, const Direction& direction, Formulation formulation);
template <class Real>
Real listed_length(const Spring& spring, Formulation formulation);

/// How springs of each direction code lie at rest.
template <class Real>
std::array<SpringRest<Real>, direction_codes> rest_by_code(const Problem& problem);

/// How a spring beyond the lattice lies at rest, from `particle` to `neighbour`.
template <class Real>
SpringRest<Real> own_rest_of(const Problem& problem, std::uint32_t particle, std::uint32_t neighbour,
                             double rest_length);

/// Empty, or why a list entry cannot name particles and directions in one word, as formulations on
/// displacements need it.
std::string beyond_entries(const Problem& problem, Formulation formulation);

/// Empty, or why stiffness and rest length are not the same for all springs of a group.
std::string beyond_groups(const Problem& problem);

enum class ListLayout : std::uint8_t { vertical, concatenated };

/// Neighbour lists as records/explicit.h reads them.
template <class Real>
struct NeighbourLists {
    ListShape shape;
    std::vector<std::uint32_t> neighbour;
    std::vector<SpringConstants<Real>> constants;  ///< the secondary list; empty without
    /// Of springs beyond the lattice, by displacements; empty if there are none.
    std::vector<SpringRest<Real>> own_rest;
    std::vector<std::uint32_t> bits;            ///< one a particle: counters, active and pinned
    std::array<std::uint32_t, 3> first_slot{};  ///< of each group, without the secondary list
};

/// Elements of a list of `slots` a particle.
std::size_t list_size(std::size_t particles, std::uint32_t slots, ListLayout layout);
/// Slots a particle that list_by_groups() and list_by_springs() would make.
std::uint32_t slots_by_groups(const Problem& problem);
std::uint32_t slots_by_springs(const Problem& problem);

/// A counter a spring group and no secondary list, for a problem that is not beyond_groups().
template <class Real>
NeighbourLists<Real> list_by_groups(const Problem& problem, ListLayout layout, Formulation formulation);
/// One counter, stiffness and rest length a spring, for any problem. A particle's lattice springs come first,
/// in the order of directions(), then those beyond the lattice in theirs.
template <class Real>
NeighbourLists<Real> list_by_springs(const Problem& problem, ListLayout layout, Formulation formulation);

/// New lists of the particles that an edit touched.
template <class Real>
struct EditedLists {
    std::vector<std::uint32_t> particle;
    NeighbourLists<Real> lists;  ///< concatenated; list n is that of particle[n]
};
/// The most springs that a touched particle has.
std::uint32_t longest_list(const SpringEdit& edit);
/// As list_by_groups() and list_by_springs() list them, `slots` a particle.
template <class Real>
EditedLists<Real> edited_by_groups(const Problem& edited, const SpringEdit& edit, std::uint32_t slots,
                                   Formulation formulation);
template <class Real>
EditedLists<Real> edited_by_springs(const Problem& edited, const SpringEdit& edit, std::uint32_t slots,
                                    Formulation formulation);

/// Every spring once. Those of the lattice by direction, then by particle, so that the threads of a warp
/// touch particles that lie together.
template <class Real>
struct SpringArrays {
    std::vector<SpringEnds> ends;
    std::vector<SpringConstants<Real>> constants;
    /// Of springs beyond the lattice, by displacements; empty if there are none.
    std::vector<SpringRest<Real>> own_rest;
    /// Where the springs of each odd mask bit begin; at the end, where those beyond the lattice do.
    std::array<std::size_t, neighbour_count + 1> begin{};
};
template <class Real>
SpringArrays<Real> list_every_spring(const Problem& problem, Formulation formulation);

/// Where a spring is in the spring array while springs come and go: one of the lattice that was listed keeps
/// its slot, which is empty while it is cut; others get slots at the end and give them back.
class SpringSlots {
public:
    SpringSlots() = default;
    /// `problem` as it was listed, which must outlive this object; `begin` as in SpringArrays.
    SpringSlots(const Problem& problem, const std::array<std::size_t, neighbour_count + 1>& begin,
                Formulation formulation);

    /// What `edit` writes into the array: each slot once, in any order.
    template <class Real>
    std::vector<EditedSpring<Real>> slots_of(const SpringEdit& edit);
    /// Slots that have ever been in use.
    std::size_t used() const { return used_; }

private:
    /// A range of slots to search or, empty, a slot.
    using Range = std::pair<std::size_t, std::size_t>;
    /// `freed`: slots that later edits may give to others; within one edit a slot is written once.
    Range remove(const ChangedSpring& changed, std::vector<std::size_t>& freed);
    Range add(const ChangedSpring& changed);
    bool was_listed(const ChangedSpring& changed) const;

    const Problem* listed_ = nullptr;
    Formulation formulation_{};
    std::array<std::size_t, neighbour_count + 1> begin_{};
    std::size_t used_ = 0;
    std::vector<std::size_t> free_;
    /// Slots of the springs that were not lattice springs when listed, by their ends.
    std::multimap<std::pair<std::uint32_t, std::uint32_t>, std::size_t> others_;
};

/// Active and pinned bits of every particle.
std::vector<std::uint32_t> state_bits(const Problem& problem);

// --- Steps --------------------------------------------------------------------------------------------

// The kernels' arguments, rest lengths squared and pointers null: what is on the device is the caller's to
// fill in.
template <class Real>
ImplicitStep<Real> make_implicit_step(const Problem& problem, const Placement& placement,
                                      Formulation formulation);
template <class Real>
ExplicitStep<Real> make_explicit_step(const Problem& problem, const NeighbourLists<Real>& lists,
                                      Formulation formulation);
template <class Real>
ScatterStep<Real> make_scatter_step(const Problem& problem, const SpringArrays<Real>& springs);

/// Terms of records/terms.h that `problem` has, lists aside.
std::uint32_t terms_of(const Problem& problem);

// --- Blocks -------------------------------------------------------------------------------------------

/// Threads of a block along x, y, z.
struct BlockShape {
    int x = 1, y = 1, z = 1;
    /// From "32x4x2"; missing extents are 1.
    static BlockShape parse(const std::string& text);
    bool operator==(const BlockShape&) const = default;
};

/// A place for each block of a lattice, with a frame of one block around them (kernels/resting.h).
class BlockGrid {
public:
    BlockGrid(const Lattice& lattice, BlockShape shape);
    /// From a place to the next along y and z.
    std::size_t row() const { return row_; }
    std::size_t slice() const { return slice_; }
    std::size_t places() const { return places_; }
    /// Of block (x, y, z).
    std::size_t place(int x, int y, int z) const {
        return std::size_t(x + 1) + std::size_t(y + 1) * row_ + std::size_t(z + 1) * slice_;
    }
    std::size_t place_of(const Lattice& lattice, std::uint32_t voxel) const {
        const glm::ivec3 c = lattice.coordinates(voxel);
        return place(c.x / shape_.x, c.y / shape_.y, c.z / shape_.z);
    }

private:
    BlockShape shape_;
    std::size_t row_, slice_, places_;
};

/// Origins of the blocks that hold an active voxel, x fastest.
std::vector<BlockOrigin> list_blocks(const Lattice& lattice, BlockShape shape);
/// The same an active voxel; empty if all do and the blocks' own coordinates, within
/// CUDA's limits on a grid of blocks, give the origins.
std::vector<BlockOrigin> active_blocks(const Lattice& lattice, BlockShape shape);

}  // namespace voxspring::cuda
