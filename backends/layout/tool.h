// A problem's tool as devices have it, built on the host, without a device.
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "backends/layout/particles.h"
#include "backends/layout/records/tool.h"

namespace voxspring::layout {

/// Every particle that the tool holds, in the order of Tool::particles; empty without a tool.
template <class Real>
std::vector<HeldWord<Real>> pack_held(const Problem& problem, const Placement& placement,
                                      Formulation formulation);

/// The force on the tool (ToolFacet::tool_force()) from its forces on the held particles.
template <class Real>
glm::dvec3 force_on_tool(const std::vector<HeldForce<Real>>& forces);

}  // namespace voxspring::layout
