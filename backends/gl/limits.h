// Measures what an OpenGL device can do at best.
#pragma once

#include "backends/gl/context.h"
#include "backends/limits.h"

namespace voxspring::gl {

/// Measures dispatches with a barrier after each, as a ComputeBackend steps. `context` is current. It leaves
/// another program and other buffers bound.
DeviceLimits measure_compute_limits(const Context& context);
/// Measures only the time of a launch, as measure_compute_limits() does.
double measure_dispatch(const Context& context);

/// Measures draws, as a FragmentBackend steps. `context` is current and has a vertex array bound. It leaves
/// other programs, framebuffers and textures bound.
DeviceLimits measure_limits(const Context& context);
/// Measures only the time of a launch, as measure_limits() does.
double measure_draw(const Context& context);

}  // namespace voxspring::gl
