// Every spring once, for the scatter kernels, and where each one is while edits remove and add springs.
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

namespace voxspring::layout {

/// Every spring once. Springs of the lattice are ordered by direction, then by particle, so that the threads
/// of a warp touch particles that lie together.
template <class Real>
struct SpringArrays {
    std::vector<SpringEnds> ends;
    std::vector<SpringConstants<Real>> constants;
    /// How springs beyond the lattice lie at rest, by slot. Empty in formulations on positions, or if there
    /// are none.
    std::vector<SpringRest<Real>> off_lattice_rest;
    /// The slots at which the springs of each odd mask bit begin and, as the last, those beyond the lattice.
    std::array<std::size_t, neighbour_count + 1> begin{};
};
template <class Real>
SpringArrays<Real> list_every_spring(const Problem& problem, Formulation formulation);

/// Where each spring is in the spring array, while edits remove and add springs. A lattice spring that was
/// listed at first keeps its slot, which is empty (stiffness 0) while the spring is cut. All other springs
/// get slots at the end, and free them when they are removed.
class SpringSlots {
public:
    SpringSlots() = default;
    /// `problem`: as it was when its springs were listed; it must outlive this object. `begin`:
    /// SpringArrays::begin.
    SpringSlots(const Problem& problem, const std::array<std::size_t, neighbour_count + 1>& begin,
                Formulation formulation);

    /// The slots that `edit` writes, each once. They may be written in any order.
    template <class Real>
    std::vector<EditedSpring<Real>> slots_of(const SpringEdit& edit);
    /// How many slots have ever been in use.
    std::size_t used() const { return used_; }

private:
    /// A range of slots to search. An empty range stands for one slot.
    using Range = std::pair<std::size_t, std::size_t>;
    /// Removes a spring, and adds to `freed` the slot that becomes free. Only later edits may use that slot,
    /// because one edit writes a slot only once.
    Range remove(const ChangedSpring& changed, std::vector<std::size_t>& freed);
    Range add(const ChangedSpring& changed);
    bool was_listed(const ChangedSpring& changed) const;

    const Problem* listed_ = nullptr;
    Formulation formulation_{};
    std::array<std::size_t, neighbour_count + 1> begin_{};
    std::size_t used_ = 0;
    std::vector<std::size_t> free_;
    /// Slots of the springs that were not lattice springs when listed, by the particles that they join.
    std::multimap<std::pair<std::uint32_t, std::uint32_t>, std::size_t> others_;
};

/// The kernels' argument for a problem and its springs. A backend sets the pointers and `pitch`.
template <class Real>
ScatterStep<Real> make_scatter_step(const Problem& problem, const SpringArrays<Real>& springs);

/// The least work of a step: of one launch for springs and of one for particles.
template <class Real>
StepWork scatter_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
