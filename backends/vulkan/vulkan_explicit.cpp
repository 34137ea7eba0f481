// Explicit addressing in Vulkan: one invocation per particle, neighbours from vertical lists (the first
// slots of all particles, then all second slots, and so on). The host is in glsl/explicit.cpp.
#include "backends/glsl/compute_backend.h"
#include "backends/glsl/explicit.h"
#include "backends/registry.h"
#include "backends/vulkan/compute_device.h"

namespace voxspring {
namespace {

const Registered entry({
    .name = "vulkan_explicit",
    .api = "vulkan",
    .summary = "Vulkan compute shader, one invocation per particle, neighbours from lists that hold all "
               "particles' first neighbours, then all second neighbours, and so on.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"block", {"128", "256"}}, {"lists", {"auto", "addressed"}}, {"terms", {"needed", "all"}}},
    .make =
        [](const Options& options) {
            return glsl::make_explicit(options, vulkan::make_compute_device(options));
        },
    .bytes = glsl::explicit_bytes,
});

}  // namespace
}  // namespace voxspring
