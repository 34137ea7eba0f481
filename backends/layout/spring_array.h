// Every spring once, for scatter, and where each is while edits take springs away and add others.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "backends/layout/records/edit.h"
#include "backends/layout/records/scatter.h"
#include "backends/limits.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::cuda {

/// Every spring once. Those of the lattice by direction, then by particle, so that the threads of a warp
/// touch particles that lie together.
template <class Real>
struct SpringArrays {
    std::vector<SpringEnds> ends;
    std::vector<SpringConstants<Real>> constants;
    /// How springs beyond the lattice lie at rest, by displacements; empty if there are none.
    std::vector<SpringRest<Real>> off_lattice_rest;
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

/// The kernels' argument, pointers null.
template <class Real>
ScatterStep<Real> make_scatter_step(const Problem& problem, const SpringArrays<Real>& springs);

/// The least that a step takes: of springs, then of particles.
template <class Real>
StepWork scatter_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::cuda
