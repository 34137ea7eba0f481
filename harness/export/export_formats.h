// The state of a run, and the file formats for it. csv(), vti(), vtu() and npz() write all numbers with the
// precision of float64. Only npz() has `increment` as well, so that a run can resume from it.
//
// `velocity` is the velocity at the state's time, (x(t + dt) - x(t - dt)) / (2 dt), see velocities().
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "harness/scene/scene.h"

namespace voxspring {

/// A run after `step` steps. Quantities are in the scene's units.
struct Snapshot {
    const Scene& scene;
    const Problem& problem;  ///< the scene's problem as the edits so far have left it
    const State& state;
    std::int64_t step = 0;
    double time = 0;      ///< step times time step
    std::string backend;  ///< label of the backend that ran it, see BackendSpec::label()
};

/// The velocity at the snapshot's time, (x(t + dt) - x(t - dt)) / (2 dt), one element per particle. x(t + dt)
/// comes from one more step in float64, with the snapshot's springs and the scene's tool where it is in that
/// step.
std::vector<glm::dvec3> velocities(const Snapshot& snapshot);

/// A CSV table: a line that names the columns, then a line per particle with voxel, position, displacement
/// and velocity along x, y and z. Numbers read back as the same bits.
std::string csv(const Snapshot& snapshot);

/// VTK ImageData: one point per voxel, at its centre; with particles at corners, one point per corner. If a
/// volume file or mesh places the grid, Origin and Direction say where it lies in the file's coordinates, and
/// vectors are in these. Otherwise the grid begins at 0 and its axes are the coordinates. Inactive voxels
/// have zeros in the point data:
///
///     active        uint8       1 if the voxel has a particle, otherwise 0
///     label         uint8       m + 1 for a particle of material m, 0 without a particle
///     pinned        uint8
///     springs       uint8       number of lattice springs that the particle still has
///     mass          float64
///     displacement  float64, 3
///     velocity      float64, 3
///
/// Field data: TimeValue and step. Throws std::invalid_argument for a problem without a lattice.
std::string vti(const Snapshot& snapshot);

/// VTK UnstructuredGrid. It has a point per particle at its present position, in the coordinates of vti() and
/// in canonical order, and a line per spring in the order of list_springs(). Springs that were cut are
/// absent. Point data: displacement, velocity (float64, 3), mass (float64), pinned, material (uint8) and, on
/// a lattice, voxel (int32, 3). Cell data (float64): rest_length, stiffness and tension, which is the force
/// with which the spring pulls its ends together, negative if it pushes. Field data: TimeValue and step.
std::string vtu(const Snapshot& snapshot);

/// An uncompressed zip of numpy arrays. Vectors are along the grid's axes, and voxel (0, 0, 0) is at 0. With
/// n particles in canonical order and m springs in the order of list_springs():
///
///     position, displacement, velocity    (n, 3) float64
///     increment                           (n, 3) float64, x(t) - x(t - dt), which --resume needs
///     mass                                (n,) float64
///     pinned, material                    (n,) uint8
///     voxel                               (n, 3) int32, x, y, z; (0, 3) without a lattice
///     springs                             (m, 2) uint32, the particles at its ends, the smaller first
///     rest_length, stiffness, tension     (m,) float64, as in vtu()
///     lattice_springs                     () int64, the number of lattice springs, which come first
///     dims                                (3,) int32, voxels along x, y, z
///     spacing                             (3,) float64
///     step                                () int64
///     time, time_step                     () float64
std::string npz(const Snapshot& snapshot);

// The surface of a body. For a body that was made of a mesh it is that mesh, deformed with the body
// (carried_mesh.h); otherwise it is the surface of the voxels (body_mesh.h).
//
// Vertices and triangles of a mesh keep their order. Copies of vertices, made at cuts, come last. Positions
// are in the coordinates of the mesh's file, in its unit of length. Polygons of the file are written as
// triangles. The surface of voxels is in the coordinates of vtu().

/// Binary STL, float32.
std::string stl(const Snapshot& snapshot);
/// OBJ, as text. Numbers read back as the same bits.
std::string obj(const Snapshot& snapshot);
/// PLY, binary little-endian, float64.
std::string ply(const Snapshot& snapshot);
/// VTK UnstructuredGrid. Its cells are tetrahedra if the body was made of a mesh of tetrahedra, otherwise
/// triangles. Point data: displacement (float64, 3). Field data: TimeValue and step.
std::string mesh_vtu(const Snapshot& snapshot);

}  // namespace voxspring
