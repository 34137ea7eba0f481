// What a host tells shaders/compute_implicit.comp about a problem.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "backends/glsl/compute.h"
#include "backends/layout/blocks.h"

namespace voxspring::glsl {

/// Work groups that cover the particles of a lattice.
struct VoxelGroups {
    glm::ivec3 groups{0};
    /// Where each group begins, in whole rows of groups. Empty if the groups cover the lattice.
    std::vector<layout::BlockOrigin> origins;
};
VoxelGroups groups_of(const Lattice& lattice, layout::BlockShape shape);

/// 1 / stiffness of each word's material. It is 1 if a problem of one material needs the same value for all
/// words.
template <class Real>
std::vector<Real> compliances(const Problem& problem, const layout::Placement& placement, bool all_terms);

/// Bytes that upload() of a backend takes.
std::uint64_t implicit_bytes(const Problem& problem, const Options& options);

/// Empty, or why work groups cannot cover the lattice.
std::string too_long(const Lattice& lattice, layout::BlockShape shape);

/// Whether subgroups vote on skipping masks (tuning `interior`). `auto`: where the vote was faster in OpenGL
/// on an H200 (gl/README.md), but never in software, where Mesa computes both ways for every subgroup.
bool votes(const Options& options, bool is_software);

/// The constants beyond those of shaders/terms.glsl. With `votes` these include the extents of the grid: that
/// gained 1% to 10% with the vote and nothing without (gl/README.md), and needs one program per lattice.
Constants implicit_constants(const Problem& problem, bool has_origins, bool votes);

/// Sets the shader's uniforms. `measure(lengths)` turns squares into lengths as the device measures them.
template <class Real, class Uniforms, class Measure>
void set_implicit(Uniforms&& uniforms, const Problem& problem, Formulation formulation, Measure measure) {
    layout::ImplicitStep<Real> step =
        layout::make_implicit_step<Real>(problem, layout::place_on_grid(problem.lattice), formulation);
    if (!by_increments(formulation)) measure(step.rest_length);
    uniforms.set("grid_dims", problem.lattice.dims);
    uniforms.set("grid_first_word", step.first);
    uniforms.set("rest_length", step.rest_length);
    uniforms.set("rest_deficit", step.deficit);
    std::array<Real, 3> stiffness{1, 1, 1};  // with materials each particle carries it
    if (!problem.has_materials()) std::copy_n(step.stiffness, 3, stiffness.begin());
    uniforms.set("group_stiffness", stiffness);
}

}  // namespace voxspring::glsl
