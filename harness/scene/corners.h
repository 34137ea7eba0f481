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
    std::array<double, 3> stiffness{1, 1, 1};  ///< per spring group, of a spring deep inside this material
};

/// Makes a particle at each corner of an active voxel; the body is then exactly as wide as its voxels. Each
/// voxel gives an eighth of its mass to each of its corners, a quarter of its material's stiffness to each of
/// its 12 edges (face springs), half of it to each of its 12 face diagonals (edge springs) and all of it to
/// its 4 space diagonals (corner springs). A homogeneous strain then has in every voxel the energy that it
/// has in the continuum. With face and edge springs it exerts on every particle the force that trilinear
/// finite elements exert, so that free surfaces are neither too stiff nor too soft. With corner springs,
/// shear puts other forces on particles at the corners of the body.
///
/// Springs as stiff as a face spring deep inside materials[0] are lattice springs; all others are in
/// Problem::springs. The lattice's dims are voxels.dims + 1, and particle (0, 0, 0) is at the origin.
/// `materials` has one element per label. Throws std::invalid_argument if particles have more than 254
/// different masses.
Problem make_corner_problem(const VoxelGrid& voxels, std::uint32_t group_bits,
                            const std::vector<VoxelMaterial>& materials);

}  // namespace voxspring
