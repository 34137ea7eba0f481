// Implicit addressing in a compute shader of OpenGL: one invocation per voxel, neighbours by their place in
// the grid. The host is in glsl/implicit.cpp.
#include "backends/gl/compute_device.h"
#include "backends/glsl/compute_backend.h"
#include "backends/glsl/implicit.h"
#include "backends/registry.h"

namespace voxspring {
namespace {

const Registered entry({
    .name = "gl_compute_implicit",
    .api = "opengl",
    .addressing = Addressing::by_grid,
    .summary = "OpenGL compute shader, one invocation per voxel, neighbours by grid offset and mask.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = {{"block", {"32x4x2", "64x4x1", "32x8x1", "128x1x1", "8x8x4"}},
               {"fetch", {"buffer", "texture"}},
               {"interior", {"auto", "mask", "vote"}},
               {"terms", {"needed", "all"}},
               {"tile", {"none", "shared"}}},
    .make =
        [](const Options& options) { return glsl::make_implicit(options, gl::make_compute_device(options)); },
    .bytes = glsl::implicit_bytes,
});

}  // namespace
}  // namespace voxspring
