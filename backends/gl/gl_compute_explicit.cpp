// Explicit addressing in a compute shader of OpenGL: one invocation per particle, which reads its neighbours
// from a list. The lists are interleaved: first the first slot of every particle, then the second slot of
// every particle, and so on. The host is in glsl/explicit.cpp.
#include "backends/gl/compute_device.h"
#include "backends/glsl/compute_backend.h"
#include "backends/glsl/explicit.h"
#include "backends/registry.h"

namespace voxspring {
namespace {

const Registered entry({
    .name = "gl_compute_explicit",
    .api = "opengl",
    .summary = "OpenGL compute shader, one invocation per particle, neighbours from lists that hold all "
               "particles' first neighbours, then all second neighbours, and so on.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = {{"block", {"128", "256"}}, {"fetch", {"buffer", "texture"}}, {"terms", {"needed", "all"}}},
    .make =
        [](const Options& options) { return glsl::make_explicit(options, gl::make_compute_device(options)); },
    .bytes = glsl::explicit_bytes,
});

}  // namespace
}  // namespace voxspring
