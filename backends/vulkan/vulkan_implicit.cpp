// Implicit addressing in Vulkan: one invocation per voxel, neighbours by their place in the grid. The host is
// in glsl/implicit.cpp.
#include "backends/glsl/compute_backend.h"
#include "backends/glsl/implicit.h"
#include "backends/registry.h"
#include "backends/vulkan/compute_device.h"

namespace voxspring {
namespace {

const Registered entry({
    .name = "vulkan_implicit",
    .api = "vulkan",
    .addressing = Addressing::by_grid,
    .summary = "Vulkan compute shader, one invocation per voxel, neighbours by grid offset and mask.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"block", {"32x4x2", "64x4x1", "32x8x1", "128x1x1", "8x8x4"}},
               {"interior", {"auto", "mask", "vote"}},
               {"terms", {"needed", "all"}}},
    .make =
        [](const Options& options) {
            return glsl::make_implicit(options, vulkan::make_compute_device(options));
        },
    .bytes = glsl::implicit_bytes,
});

}  // namespace
}  // namespace voxspring
