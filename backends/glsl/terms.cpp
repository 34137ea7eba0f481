#include "backends/glsl/terms.h"

#include <algorithm>

#include "backends/physics/neighbours.h"

namespace voxspring::glsl {
namespace {

/// Whether springs of the lattice are stressed at rest.
bool has_deficits(const Problem& problem) {
    return std::any_of(directions().begin(), directions().end(), [&](const Direction& direction) {
        return (problem.group_bits >> direction.bit & 1u) != 0 &&
               rest_spring(problem, direction).deficit != 0;
    });
}

}  // namespace

Defines formulation_defines(Formulation formulation) {
    Defines defines;
    if (on_positions(formulation)) defines["ON_POSITIONS"] = "";
    if (by_increments(formulation)) defines["BY_INCREMENTS"] = "";
    if (formulation == Formulation::paper) defines["PAPER"] = "";
    if (formulation == Formulation::compensated) defines["COMPENSATED"] = "";
    return defines;
}

Constants term_constants(const Problem& problem, Formulation formulation, bool all) {
    Constants constants;
    const auto add = [&](const char* name, bool needed) { constants[name] = text(all || needed); };
    add("DAMPING", problem.damping != 0);
    add("GRAVITY", problem.has_gravity());
    add("PINS", !problem.pinned.empty());
    add("LOADS", needs_loads(problem, all));
    add("MATERIALS", needs_materials(problem, all));
    add("FACES", (problem.group_bits & FACE_BITS) != 0);
    add("EDGES", (problem.group_bits & EDGE_BITS) != 0);
    add("CORNERS", (problem.group_bits & CORNER_BITS) != 0);
    constants["DEFICITS"] = text(by_increments(formulation) && (all || has_deficits(problem)));
    return constants;
}

bool needs_loads(const Problem& problem, bool all_terms) { return all_terms || !problem.load.empty(); }
bool needs_materials(const Problem& problem, bool all_terms) { return all_terms || problem.has_materials(); }

}  // namespace voxspring::glsl
