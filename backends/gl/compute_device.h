// OpenGL as a device (glsl/device.h) for the host code that all compute shaders share
// (glsl/compute_backend.h). A barrier follows every dispatch (README.md).
#pragma once

#include <memory>

#include "backends/glsl/device.h"

namespace voxspring::gl {

/// Makes a device that reads the particles' positions as the tuning `fetch` says. Throws Unavailable if there
/// is no usable context.
std::unique_ptr<glsl::Device> make_compute_device(const Options& options);

}  // namespace voxspring::gl
