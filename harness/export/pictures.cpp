#include "harness/export/pictures.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "backends/registry.h"
#include "harness/base/json.h"
#include "harness/mesh/carried_mesh.h"
#include "harness/scene/parts.h"
#include "harness/verification/reference.h"

namespace voxspring {

Pictures::Reference::Reference(const Scene& scene, int steps)
    : backend(References::backend_of(scene, steps)), runner(scene) {
    runner.rewind(*backend);
}

Pictures::Pictures(Colouring colouring, glm::ivec2 size) : colouring_(colouring), size_(size) {}

const std::vector<std::uint32_t>& Pictures::loose_of(const Scene& scene) {
    if (scene_ != &scene) loose_ = parts_of(scene.problem).loose();
    scene_ = &scene;
    return loose_;
}

std::vector<double> Pictures::values_of(const Snapshot& snapshot) {
    std::vector<glm::dvec3> difference = snapshot.state.displacement;
    if (colouring_ == Colouring::error) {
        if (!reference_ || reference_->step > snapshot.step)
            reference_.emplace(snapshot.scene, int(snapshot.step));
        reference_->runner.run(*reference_->backend, int(snapshot.step - reference_->step));
        reference_->step = snapshot.step;
        const State state = reference_->backend->download();
        for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= state.displacement[i];
    }
    std::vector<double> values;
    values.reserve(difference.size());
    for (const glm::dvec3& vector : difference) values.push_back(glm::length(vector));
    std::vector<double> held = values;
    for (const std::uint32_t i : loose_of(snapshot.scene)) held[i] = 0;
    largest_ = held.empty() ? 0 : *std::max_element(held.begin(), held.end());
    return values;
}

void Pictures::show(const Snapshot& snapshot, const std::vector<glm::dvec3>& displacement,
                    const std::vector<double>& values) {
    if (!snapshot.scene.mesh) {
        painter_.set_mesh(mesh_of(snapshot.problem));
        painter_.put_displacements(displacement);
        if (!values.empty()) painter_.put_values(values);
        return;
    }
    const CarriedMesh mesh = carried(*snapshot.scene.mesh, snapshot.problem, displacement, values);
    painter_.set_mesh(mesh_of(mesh.rest, mesh.triangles));
    painter_.put_displacements(mesh.displacement);
    if (!values.empty()) painter_.put_values(mesh.value);
}

void Pictures::look_at(const Snapshot& snapshot) {
    (void)values_of(snapshot);
    largest_of_all_ = std::max(largest_of_all_, largest_);
    std::vector<glm::dvec3> displacement = snapshot.state.displacement;
    for (const std::uint32_t i : loose_of(snapshot.scene)) displacement[i] = glm::dvec3(0);
    show(snapshot, displacement, {});
    camera_.include(painter_.places());
}

std::string Pictures::png(const Snapshot& snapshot) {
    if (camera_.empty()) look_at(snapshot);
    std::vector<double> values = values_of(snapshot);
    const Scale scale(colouring_, largest_of_all_, largest_);
    for (double& value : values) value = scale.place(value);
    show(snapshot, snapshot.state.displacement, values);
    painter_.draw(camera_.view(size_, 1 - legend_share), {.low = 0, .high = 1, .colours = colouring_});
    Image image = painter_.picture();
    draw_legend(image, scale);
    const nlohmann::json about = {{"scene", snapshot.scene.name},
                                  {"particles", snapshot.problem.particle_count()},
                                  {"steps", snapshot.step},
                                  {"backend", snapshot.backend},
                                  {"coloured_by", to_string(colouring_)},
                                  {"largest", largest_},
                                  {"renderer", context_.capabilities().device}};
    return encode_png(image, json_text(about));
}

}  // namespace voxspring
