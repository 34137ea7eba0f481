// How a problem specialises the shaders of shaders/, for any API: macros, constants and uniforms by name.
#pragma once

#include <glm/vec3.hpp>
#include <map>
#include <string>

#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::glsl {

/// Values of macros by name.
using Defines = std::map<std::string, std::string>;
/// Values of constants by name, as GLSL writes them: "true", "false" or a whole number. A shader gets a value
/// for each of its constants. TILE, a macro that only OpenGL uses, has an empty value.
using Constants = std::map<std::string, std::string>;

inline std::string text(bool value) { return value ? "true" : "false"; }

/// The macros of shaders/motion.glsl that select a formulation.
Defines formulation_defines(Formulation formulation);

/// The values of the constants in shaders/terms.glsl. Each says whether the shaders compute a term, such as
/// gravity or a group of springs. A term is on if the problem has it; with `all` every term is on. DEFICITS
/// is on only for formulations by increments.
Constants term_constants(const Problem& problem, Formulation formulation, bool all);
bool needs_loads(const Problem& problem, bool all_terms);
bool needs_materials(const Problem& problem, bool all_terms);

/// Sets the uniforms of shaders/motion.glsl. `Uniforms` has a set(name, value) for numbers, vectors and spans
/// of them.
template <class Real, class Uniforms>
void set_motion(Uniforms&& uniforms, const Problem& problem) {
    using Vec3 = glm::vec<3, Real>;
    uniforms.set("spacing", Vec3(problem.lattice.spacing));
    uniforms.set("damping", Real(problem.damping));
    uniforms.set("retained", Real(1 - problem.damping));
    uniforms.set("doubled", Real(2 - problem.damping));
    uniforms.set("gravity", Vec3(problem.gravity));
    uniforms.set("inverse_mass", Real(1 / problem.materials[0].mass));
    uniforms.set("time_step_squared", Real(problem.time_step * problem.time_step));
    uniforms.set("shortest_squared", Real(problem.shortest_squared()));
}

}  // namespace voxspring::glsl
