#include "backends/gl/tool_pass.h"

#include <utility>
#include <vector>

#include "backends/glsl/compute.h"
#include "backends/layout/tool.h"

namespace voxspring::gl {

using HeldForce = layout::HeldForce<float>;

void ToolPass::make(const Context& context, const Problem& problem, const layout::Placement& placement,
                    Formulation formulation, Defines defines) {
    const auto held = layout::pack_held<float>(problem, placement, formulation);
    held_.upload(context, held);
    forces_.upload(context, std::vector<HeldForce>(held.size()));
    if (held.empty()) return;
    defines.merge(glsl::formulation_defines(formulation));
    if (program_.get() == 0) program_ = Program(context, load_source("tool.comp", defines));
    program_.set("count", int(held.size()));
    program_.set("stiffness", float(problem.tool.stiffness));
    move(glm::dvec3(0));
}

void ToolPass::move(const glm::dvec3& displacement) const { program_.set("moved", glm::vec3(displacement)); }

void ToolPass::dispatch() const {
    held_.bind(glsl::held_words);
    forces_.bind(glsl::held_forces);
    glUseProgram(program_.get());
    glDispatchCompute(glsl::striding_groups(forces_.bytes() / sizeof(HeldForce)), 1, 1);
}

glm::dvec3 ToolPass::force() const {
    std::vector<HeldForce> forces(forces_.bytes() / sizeof(HeldForce));
    forces_.download(forces);
    return layout::force_on_tool(forces);
}

}  // namespace voxspring::gl
