// Measures what an OpenGL device can do at best.
#pragma once

#include "backends/gl/context.h"
#include "backends/limits.h"

namespace voxspring::gl {

/// Measures draws, as a FragmentBackend steps, and compute shaders' arithmetic. `context` must be current and
/// have a vertex array bound. Other programs, framebuffers and textures are bound afterwards.
DeviceLimits measure_limits(const Context& context);
/// Measures only DeviceLimits::launch_seconds, as measure_limits() does.
double measure_draw(const Context& context);

}  // namespace voxspring::gl
