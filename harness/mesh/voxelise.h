// Makes a body of voxels from a mesh.
#pragma once

#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/physics/problem.h"
#include "harness/mesh/mesh.h"
#include "harness/mesh/surface.h"
#include "harness/volume/dataset.h"

namespace voxspring {

/// About how many voxels there are along the longest side of a mesh if the user chose no pitch (edge of a
/// voxel).
inline constexpr int default_voxels = 64;

/// A voxel belongs to the body if at least this fraction of it lies inside, unless the user chose another
/// one.
inline constexpr double default_fill = 0.5;

/// A mesh and the grid that was made of it.
struct MeshInGrid {
    Mesh mesh;
    MeshFacts facts;
    glm::dvec3 origin{0};  ///< centre of voxel (0, 0, 0), in the mesh's coordinates
    double pitch = 1;      ///< edge of a voxel, in the mesh's unit of length
    double fill = default_fill;
    /// The volume inside the mesh, where its winding number exceeds 1/2. It is the sum over all voxels of the
    /// part of each that lies inside.
    double volume = 0;
    double body_volume = 0;  ///< volume of the active voxels
};

struct Voxelised {
    VoxelGrid grid;  ///< of labels 0 and 1
    MeshInGrid source;
    std::vector<std::string> notes;  ///< for the user, like Scene::notes; those of the mesh's file come first
};

/// The pitch if the user chose none: default_voxels along the longest side, rounded to two significant
/// digits.
double default_pitch(const MeshFacts& facts);

/// Makes voxels of edge `pitch`. A voxel is active if at least the fraction `fill` of it, in (0, 1], has a
/// winding number above 1/2 with respect to the mesh. That is the inside of a closed surface. Where the
/// surface has a hole, the inside ends about where a film across the hole would be. The fraction is measured
/// along 16 lines through the voxel. Equal input gives equal bits with any number of threads. Without a pitch
/// default_pitch() is used, and a note says so. Throws BadInput if the grid is too large for `limits`, if the
/// pitch is below min_quantity, if too many triangles overlap each other, or if no voxel is active.
Voxelised voxelise(Mesh mesh, std::optional<double> pitch, double fill, const SceneSizeLimits& limits);

}  // namespace voxspring
