// The surface of a deformed body as quads: what a picture of it shows.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

struct SurfaceVertex {
    glm::dvec3 position{0};
    glm::dvec3 normal{0};  ///< outwards, of length 1; 0 where a body has collapsed
    double value = 0;
};

/// The largest surface that surface_of() makes; its vertices take 3 GiB.
inline constexpr std::size_t max_faces = std::size_t(1) << 24;

/// Four vertices a face, counter-clockwise from outside: the faces between an active voxel and an inactive
/// one, and those between two active voxels whose spring is cut. Vertices follow `displacement` and carry the
/// mean of `value` (both one a particle) over the particles around them that springs hold together, so that a
/// cut opens. Stairs of voxels come out as slopes: a vertex is where the edges from active to inactive voxels
/// around it cross on average ("surface nets").
///
/// Throws std::runtime_error where a displacement is not finite, the problem lies on no lattice or there are
/// more than max_faces.
std::vector<SurfaceVertex> surface_of(const Problem& problem, std::span<const glm::dvec3> displacement,
                                      std::span<const double> value);

}  // namespace voxspring
