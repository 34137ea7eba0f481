// Makes a surface of which inside and outside can be told from the triangles of a mesh, whatever its holes,
// and says what it met.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "harness/mesh/mesh.h"

namespace voxspring {

/// What a mesh is like, where points at the same place are one.
struct MeshFacts {
    std::size_t vertices = 0, triangles = 0, tetrahedra = 0;
    std::size_t parts = 0;               ///< pieces that share no point
    std::size_t open_edges = 0;          ///< edges that belong to one triangle only
    std::size_t holes = 0;               ///< connected sets of open edges
    std::size_t non_manifold_edges = 0;  ///< edges that belong to three triangles or more
    std::size_t flat = 0;                ///< triangles without an area
    std::size_t turned = 0;              ///< triangles that were turned over, see Surface
    glm::dvec3 low{0}, high{0};          ///< the box around the triangles
    double volume = 0;                   ///< by the divergence theorem, holes closed by fans
};

/// A closed surface: the triangles of a mesh, and caps. A cap is a fan over the edges of a hole. Each edge of
/// the two together has as many triangles on one side as on the other, whatever the mesh is.
///
/// Neighbours across an edge of two triangles are turned alike; the larger part of a piece decides. A piece
/// whose volume is negative is turned as a whole unless it lies within another, as a cavity does. A piece
/// that is nearly flat, such as a patch that is stitched to nothing, is turned as the rest around it says.
struct Surface {
    std::vector<glm::dvec3> points;  ///< the mesh's vertices, then one for each cap
    std::vector<Triangle> triangles;
    std::vector<Triangle> caps;
    MeshFacts facts;
};

Surface surface_of(const Mesh& mesh);

}  // namespace voxspring
