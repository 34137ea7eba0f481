// Reads the pixels of a framebuffer.
#pragma once

#include <glm/vec2.hpp>

#include "harness/export/image.h"

namespace voxspring {

/// The lower left `size` pixels of the framebuffer that is bound for reading. The caller checks for OpenGL
/// errors.
Image read_pixels(glm::ivec2 size);

}  // namespace voxspring
