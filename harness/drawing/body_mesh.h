// The surface of a body as a mesh whose vertices follow particles. An edit makes a new mesh necessary, a step
// does not.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// A surface of quadrangles. That of voxels has a face between an active voxel and an inactive one, and
/// between two active voxels whose spring is cut. Faces share their vertices. At rest a vertex lies at the
/// mean of the points where the edges between the voxel centres around it cross the surface ("surface nets"),
/// so that slopes have no stairs. In motion the mean displacement of the particles that the vertex follows is
/// added. A vertex follows those of the up to eight particles around it that springs connect, so that a cut
/// opens.
struct BodyMesh {
    struct Vertex {
        glm::vec3 rest{0};
        std::uint32_t count = 0;                 ///< number of particles that the vertex follows, at least 1
        std::array<std::uint32_t, 8> follows{};  ///< indices into `particles`
    };

    std::vector<std::uint32_t> particles;  ///< the particles that vertices follow, ascending
    std::vector<Vertex> vertices;
    std::vector<std::array<std::uint32_t, 4>> faces;  ///< indices of vertices, counter-clockwise from outside
    /// The faces of vertex v are face_of_vertex[first_face[v]] to face_of_vertex[first_face[v + 1] - 1].
    std::vector<std::uint32_t> first_face, face_of_vertex;
    glm::dvec3 low{0}, high{0};  ///< bounding box of the vertices at rest
};

/// The largest number of faces of a mesh.
inline constexpr std::size_t max_faces = std::size_t(1) << 24;

/// Makes the surface of a problem's voxels. Throws std::runtime_error if the problem has no lattice, or if
/// the surface has more than max_faces faces.
BodyMesh mesh_of(const Problem& problem);

/// Makes a surface of triangles in which vertex n follows particle n. A triangle is a face whose last two
/// corners are equal. Throws std::runtime_error if there are more than max_faces triangles.
BodyMesh mesh_of(const std::vector<glm::dvec3>& rest,
                 const std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace voxspring
