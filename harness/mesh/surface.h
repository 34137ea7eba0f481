// Makes a closed surface from the triangles of a mesh, even if the mesh has holes, so that inside and outside
// can be told apart. Also counts properties of the mesh, such as holes.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "harness/mesh/mesh.h"

namespace voxspring {

/// Properties of a mesh. Points at the same position count as one point.
struct MeshFacts {
    std::size_t vertices = 0, triangles = 0, tetrahedra = 0;
    std::size_t parts = 0;               ///< pieces that share no point
    std::size_t open_edges = 0;          ///< edges that belong to one triangle only
    std::size_t holes = 0;               ///< connected sets of edges that a cap closes
    std::size_t non_manifold_edges = 0;  ///< edges that belong to three triangles or more
    std::size_t flat = 0;                ///< triangles without an area
    std::size_t turned = 0;              ///< triangles whose order of corners was reversed, see Surface
    glm::dvec3 low{0}, high{0};          ///< the box around the triangles
    /// Volume by the divergence theorem, with holes closed by caps. An overlap of two parts counts twice.
    double volume = 0;
};

/// A closed surface: the triangles of a mesh, and caps. A cap is a fan of triangles that closes a hole. With
/// the caps, equally many triangles pass each edge in either direction, whatever the mesh is like.
///
/// Triangles are turned over where necessary. Neighbours across an edge of two triangles are made to face the
/// same side, the one that most of the area of their connected piece faced. A piece with a negative volume is
/// turned over as a whole, unless it is a cavity within another piece. A nearly flat piece, such as a patch
/// whose vertices were not joined to the rest, is turned so that it fits the surface around it.
struct Surface {
    std::vector<glm::dvec3> points;  ///< the mesh's vertices, then one for each cap
    std::vector<Triangle> triangles;
    std::vector<Triangle> caps;
    MeshFacts facts;
};

Surface surface_of(const Mesh& mesh);

}  // namespace voxspring
