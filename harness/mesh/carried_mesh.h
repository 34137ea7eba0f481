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

/// A mesh, deformed with its body.
struct CarriedMesh {
    /// Where the vertices are at rest: first those of the mesh in their order, then copies at cuts.
    std::vector<glm::dvec3> rest{};
    std::vector<glm::dvec3> displacement{};  ///< one per vertex, in the mesh's unit of length
    std::vector<double> value{};             ///< one per vertex; empty if no values were given
    std::vector<Triangle> triangles{};       ///< the mesh's triangles in order, some with copies as corners
    std::vector<Tetrahedron> tetrahedra{};
    std::size_t copies = 0;  ///< number of copied vertices
};

/// Deforms a mesh with the body that was made of it. `problem` is that body; edits may have cut its springs.
/// `displacement` has one element per particle, and so has `value` unless it is empty.
///
/// A vertex follows the affine motion that best fits the motion of the particles around it (moving least
/// squares, in which near particles weigh more). These are particles less than 2.5 voxels away along each
/// axis, if springs within this box connect them to the particle nearest to the vertex. So an affine motion
/// of the particles moves the mesh in the same way, up to rounding. If all these particles lie on a plane or
/// a line, the motion is constant perpendicular to it. A vertex without a particle in its box follows the
/// nearest particle.
///
/// At a cut the mesh separates along its edges. A triangle or tetrahedron follows the side of the particle
/// nearest to its centroid. A vertex is copied if the triangles or tetrahedra around it follow particles that
/// were connected within its box before the cut and are not connected now. A triangle much larger than a
/// voxel is not divided. No new faces close a cut, which a mesh of tetrahedra does not need.
CarriedMesh carried(const MeshInGrid& source, const Problem& problem,
                    std::span<const glm::dvec3> displacement, std::span<const double> value = {});

/// A mesh attached to the body that was made of it, for many states of the body between two edits. The result
/// is that of carried(), but the particles that a vertex follows are computed only once. Positions are in the
/// coordinates of the problem. A vertex has about 60 weights, in float32.
class BoundMesh {
public:
    BoundMesh(const MeshInGrid& source, const Problem& problem);

    std::vector<glm::dvec3> rest{};  ///< vertices as in CarriedMesh, copies at cuts last
    std::vector<Triangle> triangles{};

    /// Interpolates displacements (dvec3) or values (double) from the particles to the vertices.
    template <class Value>
    std::vector<Value> at_vertices(std::span<const Value> of_particles) const;

private:
    std::vector<std::size_t> first_{};                         ///< start of each vertex's list in followed_
    std::vector<std::pair<std::uint32_t, float>> followed_{};  ///< particles and their weights
};

}  // namespace voxspring
