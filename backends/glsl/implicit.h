// What shaders/compute_implicit.comp is told of a problem.
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
    /// Where each begins, whole rows of them; empty where they cover the lattice.
    std::vector<cuda::BlockOrigin> origins;
};
VoxelGroups groups_of(const Lattice& lattice, cuda::BlockShape shape);

/// 1 / stiffness of each word's material, or 1 where a problem of one material is to have them all the same.
template <class Real>
std::vector<Real> compliances(const Problem& problem, const cuda::Placement& placement, bool all_terms);

/// Bytes that upload() of a backend takes.
std::uint64_t implicit_bytes(const Problem& problem, const Options& options);

/// Empty, or why work groups cannot cover the lattice.
std::string too_long(const Lattice& lattice, cuda::BlockShape shape);

/// Whether subgroups vote on leaving out masks (tuning `interior`). `auto`: where it was faster in OpenGL on
/// an H200 (gl/README.md), and never in software, where Mesa computes both ways for every subgroup.
bool votes(const Options& options, bool is_software);

/// The constants beyond those of shaders/terms.glsl. With `votes` the extents of the grid are some too: that
/// brought 1% to 10% with the vote and nothing without (gl/README.md), and costs a program a lattice.
Constants implicit_constants(const Problem& problem, bool has_origins, bool votes);

/// Its own uniforms. `measure(lengths)` makes lengths of squares, as the device measures them.
template <class Real, class Uniforms, class Measure>
void set_implicit(Uniforms&& uniforms, const Problem& problem, Formulation formulation, Measure measure) {
    cuda::ImplicitStep<Real> step =
        cuda::make_implicit_step<Real>(problem, cuda::place_on_grid(problem.lattice), formulation);
    if (!by_increments(formulation)) measure(step.rest_length);
    uniforms.set("grid_dims", problem.lattice.dims);
    uniforms.set("grid_first_word", step.first);
    uniforms.set("rest_length", step.rest_length);
    uniforms.set("rest_deficit", step.deficit);
    std::array<Real, 3> stiffness{1, 1, 1};  // materials carry it themselves
    if (!problem.has_materials()) std::copy_n(step.stiffness, 3, stiffness.begin());
    uniforms.set("group_stiffness", stiffness);
}

}  // namespace voxspring::glsl
