#include "harness/view/body_mesh.h"

#include <algorithm>
#include <glm/common.hpp>
#include <numeric>
#include <stdexcept>
#include <string>
#include <unordered_map>

#include "harness/export/lattice_surface.h"
#include "harness/export/surface.h"

namespace voxspring {
namespace {

/// Collects vertices without duplicates: around a corner of the lattice there is one vertex for each set of
/// particles that springs hold together.
class Vertices {
public:
    Vertices(const Problem& problem, const LatticeSurface& surface)
        : problem_(problem),
          surface_(surface),
          corners_(glm::u64vec3(problem.lattice.dims) + std::uint64_t(1)) {}

    std::uint32_t vertex(const LatticeSurface::Face& face, glm::ivec3 sign) {
        const LatticeSurface::Corner corner = surface_.corner(face.voxel, sign);
        std::uint32_t first = no_particle;
        for (std::size_t n = 0; n < 8; ++n) {
            if ((corner.inside >> n & 1) != 0) first = std::min(first, corner.particle[n]);
        }
        const glm::u64vec3 at(face.voxel + (sign + 1) / 2);
        const std::uint64_t place = (at.z * corners_.y + at.y) * corners_.x + at.x;
        // The voxel of the set's first particle, one of the eight around the corner, identifies the set.
        std::uint64_t set = 0;
        for (std::uint64_t n = 0; n < 8; ++n) {
            if (first == corner.particle[n]) {
                const glm::ivec3 voxel = face.voxel + sign * LatticeSurface::place_of(unsigned(n));
                const glm::u64vec3 side(glm::ivec3(at) - voxel);  // 0 or 1 along each axis
                set = side.z * 4 + side.y * 2 + side.x;
            }
        }
        const auto [known, is_new] = by_place_.try_emplace(place * 8 + set, std::uint32_t(vertices.size()));
        if (is_new) vertices.push_back(made(face, sign, corner));
        return known->second;
    }

    std::vector<BodyMesh::Vertex> vertices;  ///< here they follow indices of the problem's particles

private:
    BodyMesh::Vertex made(const LatticeSurface::Face& face, glm::ivec3 sign,
                          const LatticeSurface::Corner& corner) const {
        BodyMesh::Vertex vertex;
        vertex.rest = problem_.rest_position[face.particle] +
                      problem_.lattice.spacing * glm::dvec3(sign) * corner.crossing;
        for (std::size_t n = 0; n < 8; ++n) {
            if ((corner.inside >> n & 1) != 0) vertex.follows[vertex.count++] = corner.particle[n];
        }
        return vertex;
    }

    const Problem& problem_;
    const LatticeSurface& surface_;
    const glm::u64vec3 corners_;
    std::unordered_map<std::uint64_t, std::uint32_t> by_place_;
};

/// Fills mesh.particles, and replaces the particles that vertices follow by indices into it.
void number_particles(BodyMesh& mesh) {
    for (const BodyMesh::Vertex& vertex : mesh.vertices)
        mesh.particles.insert(mesh.particles.end(), vertex.follows.begin(),
                              vertex.follows.begin() + vertex.count);
    std::sort(mesh.particles.begin(), mesh.particles.end());
    mesh.particles.erase(std::unique(mesh.particles.begin(), mesh.particles.end()), mesh.particles.end());
    for (BodyMesh::Vertex& vertex : mesh.vertices) {
        for (std::size_t n = 0; n < vertex.count; ++n) {
            const auto found =
                std::lower_bound(mesh.particles.begin(), mesh.particles.end(), vertex.follows[n]);
            vertex.follows[n] = std::uint32_t(found - mesh.particles.begin());
        }
    }
}

void list_faces_of_vertices(BodyMesh& mesh) {
    mesh.first_face.assign(mesh.vertices.size() + 1, 0);
    for (const auto& face : mesh.faces) {
        for (const std::uint32_t vertex : face) ++mesh.first_face[vertex + 1];
    }
    std::partial_sum(mesh.first_face.begin(), mesh.first_face.end(), mesh.first_face.begin());
    mesh.face_of_vertex.resize(4 * mesh.faces.size());
    std::vector<std::uint32_t> next(mesh.first_face.begin(), mesh.first_face.end() - 1);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        for (const std::uint32_t vertex : mesh.faces[f])
            mesh.face_of_vertex[next[vertex]++] = std::uint32_t(f);
    }
}

}  // namespace

BodyMesh mesh_of(const Problem& problem) {
    if (problem.lattice.voxel.size() != problem.particle_count())
        throw std::runtime_error("a network that lies on no lattice has no surface to draw");
    const LatticeSurface surface(problem);
    Vertices vertices(problem, surface);
    BodyMesh mesh;
    surface.visit_open_faces([&](const LatticeSurface::Face& open) {
        if (mesh.faces.size() == max_faces)
            throw std::runtime_error("the surface has more than " + std::to_string(max_faces) +
                                     " faces, too many to draw");
        const auto corners = LatticeSurface::corners_of(open);
        auto& face = mesh.faces.emplace_back();
        for (std::size_t n = 0; n < 4; ++n) face[n] = vertices.vertex(open, corners[n]);
    });
    mesh.vertices = std::move(vertices.vertices);
    number_particles(mesh);
    list_faces_of_vertices(mesh);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const glm::dvec3 rest(mesh.vertices[v].rest);
        mesh.low = v == 0 ? rest : glm::min(mesh.low, rest);
        mesh.high = v == 0 ? rest : glm::max(mesh.high, rest);
    }
    return mesh;
}

}  // namespace voxspring
