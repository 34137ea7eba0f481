// One thread a spring, which adds its force to both of its particles with atomics: what most users write
// first. The bodies of its two kernels.
#pragma once

#include "cuda/kernels/motion.h"

namespace voxspring::cuda {

/// Everything a step needs besides positions.
template <class Real>
struct ScatterStep {
    int particles;
    std::size_t springs;  ///< slots of both arrays; a stiffness of 0 marks one without a spring
    const SpringEnds* ends;
    const SpringConstants<Real>* constants;
    /// x of all particles, then y, then z, `pitch` apart: neighbouring threads then add to neighbouring
    /// addresses. Zero between steps.
    Real* force;
    std::size_t pitch;
    Motion<Real> motion;
    bool operator==(const ScatterStep&) const = default;
};

template <class Real>
VOXSPRING_HOST_DEVICE void add_atomically(Real* sum, Real value) {
#ifdef __CUDA_ARCH__
    atomicAdd(sum, value);
#else
    *sum += value;
#endif
}

/// Adds the force of spring s.
template <class Real, class Current>
VOXSPRING_HOST_DEVICE void scatter_spring(const ScatterStep<Real>& step, std::size_t s,
                                          const Current& current) {
    if (s >= step.springs) return;
    const SpringConstants<Real> constants = current.entry(step.constants + s);
    if (constants.stiffness == 0) return;  // a spring that was cut, or room for one to come
    const SpringEnds ends = current.entry(step.ends + s);
    const Vector<Real> offset =
        current.at(int(ends.first), 0).position - current.at(int(ends.second), 0).position;
    const Vector<Real> force =
        offset * (unit_force_density(offset, constants.rest_length, step.motion.shortest_squared) *
                  constants.stiffness);
    Real* first = step.force + ends.first;
    Real* second = step.force + ends.second;
    add_atomically(first, force.x);
    add_atomically(first + step.pitch, force.y);
    add_atomically(first + 2 * step.pitch, force.z);
    add_atomically(second, -force.x);
    add_atomically(second + step.pitch, -force.y);
    add_atomically(second + 2 * step.pitch, -force.z);
}

/// Moves particle i and leaves its force at zero for the next step.
template <class Real, class Current>
VOXSPRING_HOST_DEVICE void integrate(const ScatterStep<Real>& step, int i, const Current& current,
                                     Word<Real>* previous) {
    if (i >= step.particles) return;
    Real* sum = step.force + i;
    const Vector<Real> force{sum[0], sum[step.pitch], sum[2 * step.pitch]};
    sum[0] = sum[step.pitch] = sum[2 * step.pitch] = 0;
    const Particle<Real> self = current.at(i, 0);
    const Vector<Real> before = load_past_l1(previous + i).position;
    store(previous + i, moved(step.motion, i, self, before, force));
}

}  // namespace voxspring::cuda
