// The bodies of two kernels. In the first, each spring has a thread, which adds the spring's force to both of
// its particles with atomics: this is what most users write first. The second moves the particles.
#pragma once

#include "backends/layout/records/scatter.h"
#include "cuda/kernels/explicit.h"

namespace voxspring::cuda {

template <class Real>
VOXSPRING_HOST_DEVICE void add_atomically(Real* sum, Real value) {
#ifdef __CUDA_ARCH__
    atomicAdd(sum, value);
#else
    *sum += value;
#endif
}

/// Adds the force of spring s to both of its particles' sums.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE void scatter_spring(const ScatterStep<Real>& step, std::size_t s,
                                          const Current& current) {
    if (s >= step.springs) return;
    const SpringConstants<Real> constants = current.entry(step.constants + s);
    if (constants.stiffness == 0) return;  // the spring was cut, or the slot is free
    const SpringEnds ends = current.entry(step.ends + s);
    const int other = listed_index<Terms>(ends.second);
    SpringRest<Real> rest = listed_rest<Terms>(step.rest, ends.second);
    if (Terms::template has<term_off_lattice_rests>(step.off_lattice_rest != nullptr) &&
        ends.second >> LISTED_INDEX_BITS == OWN_DIRECTION)
        rest = step.off_lattice_rest[s];
    const Pull<Real> pull = unit_pull<Terms>(current.point(int(ends.first), 0) - current.point(other, 0),
                                             rest, constants.rest_length, step.motion.shortest_squared);
    const Vector<Real> force = pull.offset * (pull.density * constants.stiffness);
    Real* first = step.force + ends.first;
    Real* second = step.force + other;
    add_atomically(first, force.x);
    add_atomically(first + step.pitch, force.y);
    add_atomically(first + 2 * step.pitch, force.z);
    add_atomically(second, -force.x);
    add_atomically(second + step.pitch, -force.y);
    add_atomically(second + 2 * step.pitch, -force.z);
}

/// Moves particle i, and sets its force to zero for the next step.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE void integrate(const ScatterStep<Real>& step, int i, const Current& current,
                                     const Output<Real>& output) {
    if (i >= step.particles) return;
    Real* sum = step.force + i;
    const Vector<Real> force = load_axes(sum, step.pitch);
    store_axes(sum, step.pitch, Vector<Real>{0, 0, 0});
    const Self<Real, Terms::split> self = current.self(i);
    integrate_and_store<Terms>(step.motion, output, i, self, load_before<Terms>(output, i), force);
}

}  // namespace voxspring::cuda
