// An array of all springs, each once, for the scatter kernels; and in which slot each spring is while edits
// remove and add springs.
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

/// All springs, each once. Lattice springs are ordered by direction, then by particle, so that the threads of
/// a warp touch particles that lie together. An index in these arrays is a slot.
template <class Real>
struct SpringArrays {
    std::vector<SpringEnds> ends;
    std::vector<SpringConstants<Real>> constants;
    /// How springs beyond the lattice lie at rest, by slot. Empty in formulations on positions, or if there
    /// are no such springs.
    std::vector<SpringRest<Real>> off_lattice_rest;
    /// The slot at which the springs of each odd mask bit begin and, as the last element, the slot at which
    /// those beyond the lattice begin.
    std::array<std::size_t, neighbour_count + 1> begin{};
};
template <class Real>
SpringArrays<Real> list_every_spring(const Problem& problem, Formulation formulation);

/// In which slot each spring is, while edits remove and add springs. A lattice spring that was listed at
/// first keeps its slot, which is empty (stiffness 0) while the spring is cut. All other springs get slots at
/// the end, and free them when they are removed.
class SpringSlots {
public:
    SpringSlots() = default;
    /// `problem`: the problem whose springs were listed. It must stay as it was then, and must outlive this
    /// object. `begin`: SpringArrays::begin.
    SpringSlots(const Problem& problem, const std::array<std::size_t, neighbour_count + 1>& begin,
                Formulation formulation);

    /// What `edit` writes: each slot at most once, so that the slots may be written in any order.
    template <class Real>
    std::vector<EditedSpring<Real>> slots_of(const SpringEdit& edit);
    /// The number of slots from the first to the last that has ever been in use.
    std::size_t used() const { return used_; }

private:
    /// A range of slots in which a kernel searches for the spring's slot. An empty range stands for the one
    /// slot at which it begins.
    using Range = std::pair<std::size_t, std::size_t>;
    /// Removes a spring, and adds to `freed` the slot that becomes free, if any. Only later edits may use
    /// that slot, because one edit writes a slot only once.
    Range remove(const ChangedSpring& changed, std::vector<std::size_t>& freed);
    Range add(const ChangedSpring& changed);
    bool was_listed(const ChangedSpring& changed) const;

    const Problem* listed_ = nullptr;
    Formulation formulation_{};
    std::array<std::size_t, neighbour_count + 1> begin_{};
    std::size_t used_ = 0;
    std::vector<std::size_t> free_;
    /// The slots of all springs but the lattice springs that were listed at first, by the particles that they
    /// join.
    std::multimap<std::pair<std::uint32_t, std::uint32_t>, std::size_t> others_;
};

/// Makes the kernels' argument for a problem and its springs. The caller sets the pointers and `pitch`.
template <class Real>
ScatterStep<Real> make_scatter_step(const Problem& problem, const SpringArrays<Real>& springs);

/// The least work (bytes, operations, launches) of a step, which is one launch for springs, if there are any,
/// and one for particles.
template <class Real>
StepWork scatter_work(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
