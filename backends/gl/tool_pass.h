// What the tool does before a step, in a compute shader (shaders/tool.comp), for any layout of the particles.
#pragma once

#include <glm/vec3.hpp>

#include "backends/gl/program.h"
#include "backends/gl/storage_buffer.h"
#include "backends/layout/particles.h"
#include "backends/physics/formulation.h"

namespace voxspring::gl {

class ToolPass {
public:
    /// Prepares for a problem whose particles lie as `placement` says. The tool is where it took hold.
    /// `defines` specialise the shader beyond the formulation.
    void make(const Context& context, const Problem& problem, const layout::Placement& placement,
              Formulation formulation, Defines defines);
    bool has_tool() const { return held_.bytes() > 0; }

    // These functions are for a problem with a tool.
    void move(const glm::dvec3& displacement) const;
    /// Binds the pass's buffers and dispatches; the state and the loads must be bound. Leaves its program in
    /// use.
    void dispatch() const;
    /// The force on the tool in the latest step.
    glm::dvec3 force() const;

private:
    Program program_;  // made with the first problem that has a tool
    StorageBuffer held_, forces_;
};

}  // namespace voxspring::gl
