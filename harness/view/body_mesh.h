// The surface of a body as a card keeps it: which particles its vertices follow. Made anew after a cut, not
// after a step.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// The faces of surface_of(), whose vertices they share. A vertex lies at its place at rest plus the mean
/// displacement of the particles that it follows: up to eight, those around it that springs hold together.
struct BodyMesh {
    struct Vertex {
        glm::vec3 rest{0};
        std::uint32_t count = 0;                 ///< of particles that it follows, at least 1
        std::array<std::uint32_t, 8> follows{};  ///< indices into `particles`
    };

    std::vector<std::uint32_t> particles;  ///< that vertices follow, ascending
    std::vector<Vertex> vertices;
    std::vector<std::array<std::uint32_t, 4>> faces;  ///< vertices, counter-clockwise from outside
    /// The faces of vertex v are face_of_vertex[first_face[v]] to face_of_vertex[first_face[v + 1] - 1].
    std::vector<std::uint32_t> first_face, face_of_vertex;
    glm::dvec3 low{0}, high{0};  ///< what the vertices at rest lie within
};

/// Throws std::runtime_error where the problem lies on no lattice or has more than max_faces (surface.h).
BodyMesh mesh_of(const Problem& problem);

}  // namespace voxspring
