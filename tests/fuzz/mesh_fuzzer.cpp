// libFuzzer: any bytes, read as a mesh in the format of the file NAME, either become a body with an active
// voxel or are refused with BadInput.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "harness/base/bad_input.h"
#include "harness/mesh/voxelise.h"

namespace {

void require(bool condition) {
    if (!condition) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const voxspring::SceneSizeLimits limits{1 << 12, 1 << 12};
    try {
        voxspring::Mesh mesh = voxspring::parse_mesh({reinterpret_cast<const char*>(data), size}, NAME);
        require(!mesh.triangles.empty());
        const voxspring::MeshFacts facts = voxspring::surface_of(mesh).facts;
        const glm::dvec3 extent = facts.high - facts.low;
        const double pitch = std::max({extent.x, extent.y, extent.z}) / 12;
        const voxspring::Voxelised body =
            voxspring::voxelise(std::move(mesh), pitch > 0 ? pitch : 1, voxspring::default_fill, limits);
        const auto& label = body.grid.label;
        require(std::find(label.begin(), label.end(), 1) != label.end());
        require(body.source.body_volume > 0);
    } catch (const voxspring::BadInput&) {
    }
    return 0;
}
