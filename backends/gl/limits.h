// What an OpenGL device can do at best.
#pragma once

#include "backends/gl/context.h"
#include "backends/limits.h"

namespace voxspring::gl {

/// In dispatches, a barrier after each, that a ComputeBackend steps by. `context` is current; program and
/// buffers bound are others afterwards.
DeviceLimits measure_compute_limits(const Context& context);
/// Of those the time of a launch alone.
double measure_dispatch(const Context& context);

/// In the draws that a FragmentBackend steps by. `context` is current and has a vertex array bound; programs,
/// framebuffers and textures bound are others afterwards.
DeviceLimits measure_limits(const Context& context);
/// Of those the time of a launch alone.
double measure_draw(const Context& context);

}  // namespace voxspring::gl
