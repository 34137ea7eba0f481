// The surface of a deformed body as quads, for pictures.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

struct SurfaceVertex {
    glm::dvec3 position{0};
    glm::dvec3 normal{0};  ///< outwards, of length 1; 0 if the body has collapsed there
    double value = 0;
};

/// The largest number of faces that surface_of() makes. Their vertices take 3 GiB.
inline constexpr std::size_t max_faces = std::size_t(1) << 24;

/// Returns four vertices per face, counter-clockwise from outside. Faces lie between an active voxel and an
/// inactive one, and between two active voxels whose spring is cut. A vertex follows the `displacement` of
/// the particles around it that springs hold together, so that a cut opens, and carries the mean of their
/// `value`. Both arrays have one element per particle. Stairs of voxels become slopes: a vertex lies at the
/// mean of the crossings of the edges from active to inactive voxels around it ("surface nets").
///
/// Throws std::runtime_error if a displacement is not finite, the problem has no lattice, or there are more
/// than max_faces.
std::vector<SurfaceVertex> surface_of(const Problem& problem, std::span<const glm::dvec3> displacement,
                                      std::span<const double> value);

}  // namespace voxspring
