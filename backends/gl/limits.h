// Measures what an OpenGL device can do at best.
#pragma once

#include "backends/gl/context.h"
#include "backends/limits.h"

namespace voxspring::gl {

/// Measures draws, as a FragmentBackend steps. `context` is current and has a vertex array bound. It leaves
/// other programs, framebuffers and textures bound.
DeviceLimits measure_limits(const Context& context);
/// Measures only the time of a launch, as measure_limits() does.
double measure_draw(const Context& context);

}  // namespace voxspring::gl
