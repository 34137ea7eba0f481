// Carries a mesh with the body that was made of it, as Mosegaard and Sorensen map detailed geometry to a
// coarser simulation.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <utility>
#include <vector>

#include "backends/physics/problem.h"
#include "harness/mesh/mesh.h"
#include "harness/mesh/voxelise.h"

namespace voxspring {

/// A mesh as the body carries it.
struct CarriedMesh {
    /// Where the vertices are at rest: first those of the mesh in their order, then copies at cuts.
    std::vector<glm::dvec3> rest{};
    std::vector<glm::dvec3> displacement{};  ///< one per vertex, in the mesh's unit of length
    std::vector<double> value{};             ///< one per vertex; empty if no values were given
    std::vector<Triangle> triangles{};       ///< of the mesh, in order; at cuts with other vertices
    std::vector<Tetrahedron> tetrahedra{};
    std::size_t copies = 0;  ///< vertices behind those of the mesh
};

/// Carries the mesh by the particles of `problem`, the body that was made of it, whose springs some edits may
/// have cut. `displacement` has one element per particle, and so has `value` unless it is empty.
///
/// A vertex follows the affine motion that fits the particles around it best (moving least squares). Those
/// are the particles less than 2.5 voxels away along each axis that springs within this box connect to the
/// nearest one; near ones weigh more. So an affine motion of the particles moves the mesh alike, to rounding,
/// unless all of them lie on one plane or line: then vertices beside it move as on it. A vertex without a
/// particle in its box moves as the nearest particle does.
///
/// At a cut the mesh parts along its edges: a triangle or tetrahedron goes with the particle that is nearest
/// to its centroid, and a vertex is copied if what is around it goes with particles that were connected in
/// its box and are not any more. A triangle much larger than a voxel does not part, nor does the mesh close a
/// cut by walls. A mesh of tetrahedra has its own.
CarriedMesh carried(const MeshInGrid& source, const Problem& problem,
                    std::span<const glm::dvec3> displacement, std::span<const double> value = {});

/// A mesh bound to the body that was made of it, for many states of it between two edits: carried(), but
/// vertices keep the particles that they follow. Places are in the coordinates of the problem. Weights are
/// float32, about 60 per vertex.
class BoundMesh {
public:
    BoundMesh(const MeshInGrid& source, const Problem& problem);

    std::vector<glm::dvec3> rest{};  ///< vertices as in CarriedMesh, copies at cuts last
    std::vector<Triangle> triangles{};

    /// What vertices have if particles have this: displacements (dvec3) or values (double).
    template <class Value>
    std::vector<Value> at_vertices(std::span<const Value> of_particles) const;

private:
    std::vector<std::size_t> first_{};                         ///< into followed_, one per vertex and the end
    std::vector<std::pair<std::uint32_t, float>> followed_{};  ///< particles and their weights
};

}  // namespace voxspring
