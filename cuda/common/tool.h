// What the tool does before a step.
#pragma once

#include "cuda/device/stream.h"
#include "cuda/kernels/tool.h"

namespace voxspring::cuda {

/// Enqueues one kernel, or none if nothing is held.
template <class Real>
void pull_held(const Holding<Real>& holding, const Stream& stream);

}  // namespace voxspring::cuda
