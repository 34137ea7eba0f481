// Formats of what a run leaves: float64 throughout, nothing of the state is lost.
//
// `velocity` is that at the state's own time, (x(t + dt) - x(t - dt)) / (2 dt), see velocities().
#pragma once

#include <string>

#include "harness/export/snapshot.h"

namespace voxspring {

/// A line for each particle after one that names the columns: voxel, position, displacement and velocity
/// along x, y and z. Numbers are the shortest texts that read back as the same bits.
std::string csv(const Snapshot& snapshot);

/// VTK ImageData: a point a voxel, at its centre. Where a volume's file says where its grid lies, Origin and
/// Direction are those of the file, and vectors are in its coordinates; otherwise the grid begins at 0, and
/// its axes are the coordinates. Point data, of which an inactive voxel has zeros:
///
///     active        uint8       1 where there is a particle
///     label         uint8       0 where there is none, m + 1 where it is of material m
///     pinned        uint8
///     springs       uint8       of the lattice, that the particle still has
///     mass          float64
///     displacement  float64, 3
///     velocity      float64, 3
///
/// Field data: TimeValue and step. Throws std::invalid_argument for a problem without a lattice.
std::string vti(const Snapshot& snapshot);

/// VTK UnstructuredGrid: a point a particle, where it is now, in the coordinates of vti() and in canonical
/// order; a line a spring, once, in the order of list_springs(), so that what was cut is not there. Point
/// data: displacement, velocity (float64, 3), mass (float64), pinned, material (uint8) and, on a lattice,
/// voxel (int32, 3). Cell data (float64): rest_length, stiffness and tension, the force with which the spring
/// pulls its ends together, negative where it pushes. Field data: TimeValue and step.
std::string vtu(const Snapshot& snapshot);

/// A zip of numpy arrays, not compressed, along the grid's axes, whose voxel (0, 0, 0) is at 0. With n
/// particles in canonical order and m springs in the order of list_springs():
///
///     position, displacement, velocity    (n, 3) float64
///     increment                           (n, 3) float64, x(t) - x(t - dt): what --resume goes on from
///     mass                                (n,) float64
///     pinned, material                    (n,) uint8
///     voxel                               (n, 3) int32, x, y, z; (0, 3) without a lattice
///     springs                             (m, 2) uint32, the particles at its ends, the smaller first
///     rest_length, stiffness, tension     (m,) float64, as in vtu()
///     lattice_springs                     () int64, how many of the springs, the first, are of the lattice
///     dims                                (3,) int32, voxels along x, y, z
///     spacing                             (3,) float64
///     step                                () int64
///     time, time_step                     () float64
std::string npz(const Snapshot& snapshot);

}  // namespace voxspring
