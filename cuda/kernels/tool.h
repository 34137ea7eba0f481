// The body of the kernel that pulls, before each step, the particles that the tool holds by springs. In that
// step a held particle's load is the sum of its load in the problem and the tool's force.
#pragma once

#include "backends/layout/records/tool.h"
#include "backends/physics/spring.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {

template <class Real>
struct Holding {
    const HeldWord<Real>* held;
    std::size_t count;
    const ToolState<Real>* tool;
    const ParticleRecord<Real>* words;
    const ParticleRecord<Real>* words_low;  ///< null: there are no low parts
    Vector<Real>* load;
    HeldForce<Real>* forces;
};

/// Stores the tool's force on held particle n, and the load of that particle in the coming step.
template <class Real>
VOXSPRING_HOST_DEVICE void pull_held(const Holding<Real>& holding, std::size_t n) {
    const HeldWord<Real> held = holding.held[n];
    const Vector<Real> low = holding.words_low != nullptr
                                 ? load_past_l1(holding.words_low + held.word).position
                                 : Vector<Real>{0, 0, 0};
    const Vector<Real> force = hold_force(held.anchor, load_past_l1(holding.words + held.word).position, low,
                                          holding.tool->moved, holding.tool->stiffness);
    holding.load[held.word] = held.load + force;
    holding.forces[n] = {force};
}

}  // namespace voxspring::cuda
