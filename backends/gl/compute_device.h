// OpenGL as a device of the shared host of compute shaders (glsl/compute_backend.h): one dispatch and the
// barrier after it (README.md).
#pragma once

#include <memory>

#include "backends/glsl/device.h"

namespace voxspring::gl {

/// Words come from storage buffers or through texture buffers (tuning `fetch`). Throws Unavailable.
std::unique_ptr<glsl::Device> make_compute_device(const Options& options);

}  // namespace voxspring::gl
