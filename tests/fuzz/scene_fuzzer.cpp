// libFuzzer: any text, read as a scene file, either becomes a scene that could be simulated or is refused
// with BadInput.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "harness/base/bad_input.h"
#include "harness/scene/scene.h"

namespace {

void require(bool condition) {
    if (!condition) std::abort();
}

bool finite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    // Small grids keep the rate up; volume files are read from the current folder.
    const voxspring::SceneSizeLimits limits{4096, 2048, 1e6};
    try {
        const voxspring::Scene scene =
            voxspring::parse_scene({reinterpret_cast<const char*>(data), size}, "scene.json", limits);
        const voxspring::Problem& problem = scene.problem;
        const std::size_t particles = problem.particle_count();
        require(particles > 0 && particles <= limits.particles);
        require(problem.lattice.voxel_count() <= limits.voxels);
        require(problem.time_step > 0 && std::isfinite(problem.time_step));
        require(problem.load.empty() || problem.load.size() == particles);
        require(problem.material.empty() || problem.material.size() == particles);
        for (const auto* list : {&scene.state.displacement, &scene.state.increment})
            require(list->empty() || list->size() == particles);
        for (std::size_t i = 0; i < particles; ++i) {
            require(problem.material.empty() || problem.material[i] < problem.materials.size());
            require(finite(scene.state.displacement_of(i)) && finite(scene.state.increment_of(i)));
        }
        for (const voxspring::Material& material : problem.materials)
            require(material.mass > 0 && material.stiffness > 0);
    } catch (const voxspring::BadInput& refused) {
        require(std::string(refused.what()).find('\n') == std::string::npos);
    }
    return 0;
}
