// Particles at the corners of voxels rather than at their centres.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// What a voxel is made of.
struct VoxelMaterial {
    double mass = 1;
    std::array<double, 3> stiffness{1, 1, 1};  ///< by group, of a spring deep inside of this material
};

/// Makes a particle at each corner of an active voxel; the body is then exactly as wide as its voxels. Each
/// voxel gives an eighth of its mass to each of its corners, a quarter of the stiffness to each of its 12
/// edges (face springs), half of it to each of its 12 face diagonals (edge springs) and all of it to its 4
/// space diagonals (corner springs). A homogeneous strain then has the energy that it has in the continuum
/// in every voxel, and exerts on every node the force that trilinear elements have there, so that free
/// surfaces are neither too stiff nor too soft.
///
/// Springs of full stiffness are those of the lattice, and the others are Problem::springs. Dims are one more
/// than those of `voxels`, and particle (0, 0, 0) is at the origin. `materials` has one element per label.
/// Throws std::invalid_argument if particles have more than 254 different masses.
Problem make_corner_problem(const VoxelGrid& voxels, std::uint32_t group_bits,
                            const std::vector<VoxelMaterial>& materials);

}  // namespace voxspring
