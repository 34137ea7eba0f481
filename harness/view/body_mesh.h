// The surface of a body as a mesh on the card, whose vertices follow particles. It is built anew after a cut,
// but not after a step.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// The faces of surface_of(), with shared vertices. The position of a vertex is its position at rest plus the
/// mean displacement of the particles that it follows: up to eight particles around it that springs hold
/// together.
struct BodyMesh {
    struct Vertex {
        glm::vec3 rest{0};
        std::uint32_t count = 0;                 ///< number of particles that it follows, at least 1
        std::array<std::uint32_t, 8> follows{};  ///< indices into `particles`
    };

    std::vector<std::uint32_t> particles;  ///< the particles that vertices follow, ascending
    std::vector<Vertex> vertices;
    std::vector<std::array<std::uint32_t, 4>> faces;  ///< indices of vertices, counter-clockwise from outside
    /// The faces of vertex v are face_of_vertex[first_face[v]] to face_of_vertex[first_face[v + 1] - 1].
    std::vector<std::uint32_t> first_face, face_of_vertex;
    glm::dvec3 low{0}, high{0};  ///< bounding box of the vertices at rest
};

/// Throws std::runtime_error if the problem has no lattice or more than max_faces (surface.h).
BodyMesh mesh_of(const Problem& problem);

}  // namespace voxspring
