// File formats for the surface of a body: the mesh that it was made of, as the body carries it
// (carried_mesh.h), or the surface of its voxels if it was made of no mesh (body_mesh.h).
//
// The vertices and triangles of a mesh keep their order, copies of vertices at cuts come last, and places are
// in the mesh's coordinates and its unit of length. Polygons that came in are triangles. A volume's surface
// is in the coordinates of vtu().
#pragma once

#include <string>

#include "harness/export/snapshot.h"

namespace voxspring {

/// Binary STL, float32.
std::string stl(const Snapshot& snapshot);
/// Text. Numbers read back as the same bits.
std::string obj(const Snapshot& snapshot);
/// Binary little-endian, float64.
std::string ply(const Snapshot& snapshot);
/// VTK UnstructuredGrid of triangles or, of a mesh of tetrahedra, of these. Point data: displacement
/// (float64, 3). Field data: TimeValue and step.
std::string mesh_vtu(const Snapshot& snapshot);

}  // namespace voxspring
