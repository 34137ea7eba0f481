#include "harness/drawing/body_mesh.h"

#include <algorithm>
#include <cstdlib>
#include <glm/common.hpp>
#include <numeric>
#include <span>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <utility>

#include "backends/layout/boxes.h"
#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

[[noreturn]] void refuse_so_many_faces() {
    throw std::runtime_error("the surface has more than " + std::to_string(max_faces) +
                             " faces, too many to draw");
}

/// Numbers the 27 voxels around a voxel, itself included, from 0 to 26. Offsets are -1, 0 or 1 along each
/// axis.
std::size_t around(glm::ivec3 offset) {
    const int index = (offset.z + 1) * 9 + (offset.y + 1) * 3 + offset.x + 1;
    return std::size_t(index);
}

/// The offset from a voxel to the n-th of the eight voxels that share one of its corners, in steps towards
/// that corner: 0 or 1 along each axis. Voxel 0 is the voxel itself.
glm::ivec3 place_of(unsigned n) { return {n & 1, n >> 1 & 1, n >> 2}; }

/// The vertex of "surface nets" in a cube of eight voxel centres, where bit n of `inside` tells whether voxel
/// place_of(n) is inside: the mean of the midpoints of all edges with exactly one end inside. The unit is the
/// voxel, and the origin is the centre of voxel 0.
glm::dvec3 mean_crossing(unsigned inside) {
    glm::dvec3 crossing(0);
    int crossings = 0;
    for (unsigned n = 0; n < 8; ++n) {
        for (unsigned a = 0; a < 3; ++a) {
            const unsigned other = n | 1U << a;
            if (other == n || (inside >> n & 1) == (inside >> other & 1)) continue;
            crossing += (glm::dvec3(place_of(n)) + glm::dvec3(place_of(other))) / 2.0;
            ++crossings;
        }
    }
    return crossings == 0 ? glm::dvec3(0.5) : crossing / double(crossings);
}

/// Collects faces, and vertices without duplicates: around a corner of the lattice there is one vertex for
/// each set of particles that springs hold together.
class Surface {
public:
    explicit Surface(const Problem& problem)
        : problem_(problem),
          at_(particle_of_voxel(problem.lattice)),
          corners_(glm::u64vec3(problem.lattice.dims) + std::uint64_t(1)),
          mask_(problem.lattice.mask) {
        for (const Direction& direction : directions()) bits_[around(direction.offset)] = 1U << direction.bit;
        for (const Spring& spring : problem.springs) join(spring.first, spring.second);
        for (std::uint32_t i = 0; i < problem.particle_count(); ++i) add_open_faces(i);
    }

    std::vector<BodyMesh::Vertex> vertices;  ///< here `follows` holds particle indices of the problem
    std::vector<std::array<std::uint32_t, 4>> faces;

private:
    /// The particle at a voxel, or no_particle. The voxel may lie outside the lattice.
    std::uint32_t at(glm::ivec3 voxel) const {
        const glm::ivec3 dims = problem_.lattice.dims;
        return layout::has_voxel(dims, voxel) ? at_[layout::index_in(dims, voxel)] : no_particle;
    }

    /// If a spring of Problem::springs connects grid neighbours, sets their bits in mask_ as for a lattice
    /// spring, since it holds the body together as well.
    void join(std::uint32_t i, std::uint32_t j) {
        const Lattice& lattice = problem_.lattice;
        const glm::ivec3 offset =
            lattice.coordinates(lattice.voxel[j]) - lattice.coordinates(lattice.voxel[i]);
        if (std::max({std::abs(offset.x), std::abs(offset.y), std::abs(offset.z)}) > 1) return;
        mask_[i] |= bits_[around(offset)];
        mask_[j] |= bits_[around(-offset)];
    }

    bool has_spring(std::uint32_t i, glm::ivec3 offset) const {
        return (mask_[i] & bits_[around(offset)]) != 0;
    }
    /// Whether particle `i` and its active neighbour at `offset` lack the spring that the problem's spring
    /// groups would give them.
    bool is_cut(std::uint32_t i, glm::ivec3 offset) const {
        return (problem_.group_bits & bits_[around(offset)]) != 0 && !has_spring(i, offset);
    }

    void add_open_faces(std::uint32_t i) {
        // A voxel that has all its face springs has no open face.
        if ((mask_[i] & FACE_BITS) == FACE_BITS) return;
        const glm::ivec3 voxel = problem_.lattice.coordinates(problem_.lattice.voxel[i]);
        for (int axis = 0; axis < 3; ++axis) {
            for (const int direction : {-1, 1}) {
                glm::ivec3 offset(0);
                offset[axis] = direction;
                if (at(voxel + offset) == no_particle || is_cut(i, offset)) add_face(voxel, axis, direction);
            }
        }
    }

    /// Adds the face of a voxel on the side `direction` along `axis`, counter-clockwise from outside.
    void add_face(glm::ivec3 voxel, int axis, int direction) {
        if (faces.size() == max_faces) refuse_so_many_faces();
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        // The order is counter-clockwise as seen from the positive end of `axis`, since u x v points there.
        std::array<std::pair<int, int>, 4> sides = {{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}};
        if (direction < 0) std::swap(sides[1], sides[3]);
        auto& face = faces.emplace_back();
        for (std::size_t n = 0; n < 4; ++n) {
            glm::ivec3 corner;
            corner[axis] = direction;
            corner[u] = sides[n].first;
            corner[v] = sides[n].second;
            face[n] = vertex(voxel, corner);
        }
    }

    /// The vertex at the corner of `voxel` towards `sign`, which is -1 or 1 along each axis.
    std::uint32_t vertex(glm::ivec3 voxel, glm::ivec3 sign) {
        std::array<std::uint32_t, 8> particle;
        for (unsigned n = 0; n < 8; ++n) particle[n] = at(voxel + sign * place_of(n));
        const unsigned inside = connected(particle, sign);
        unsigned first = 0;  // the set's particle of the lowest index, whose voxel identifies the set
        for (unsigned n = 1; n < 8; ++n) {
            if ((inside >> n & 1) != 0 && particle[n] < particle[first]) first = n;
        }
        const glm::u64vec3 corner(voxel + (sign + 1) / 2);
        const std::uint64_t place = (corner.z * corners_.y + corner.y) * corners_.x + corner.x;
        const glm::u64vec3 side(glm::ivec3(corner) - voxel -
                                sign * place_of(first));  // 0 or 1 along each axis
        const auto [known, is_new] = by_place_.try_emplace(place * 8 + side.z * 4 + side.y * 2 + side.x,
                                                           std::uint32_t(vertices.size()));
        if (is_new) {
            BodyMesh::Vertex& made = vertices.emplace_back();
            made.rest = problem_.rest_position[particle[0]] +
                        problem_.lattice.spacing * glm::dvec3(sign) * mean_crossing(inside);
            for (unsigned n = 0; n < 8; ++n) {
                if ((inside >> n & 1) != 0) made.follows[made.count++] = particle[n];
            }
        }
        return known->second;
    }

    /// Bit n tells whether springs between the eight particles around a corner connect particle[n] to
    /// particle[0].
    unsigned connected(const std::array<std::uint32_t, 8>& particle, glm::ivec3 sign) const {
        unsigned inside = 1;
        for (unsigned reached = 1; reached != 0;) {
            unsigned next = 0;
            for (unsigned from = 0; from < 8; ++from) {
                if ((reached >> from & 1) == 0) continue;
                for (unsigned to = 0; to < 8; ++to) {
                    if ((inside >> to & 1) != 0 || particle[to] == no_particle) continue;
                    if (has_spring(particle[from], sign * (place_of(to) - place_of(from)))) next |= 1U << to;
                }
            }
            inside |= next;
            reached = next;
        }
        return inside;
    }

    const Problem& problem_;
    std::vector<std::uint32_t> at_;
    const glm::u64vec3 corners_;            ///< number of the lattice's corners along each axis
    std::vector<std::uint32_t> mask_;       ///< Lattice::mask with the springs of join()
    std::array<std::uint32_t, 27> bits_{};  ///< mask bit of each direction, by around()
    std::unordered_map<std::uint64_t, std::uint32_t> by_place_;
};

/// Fills mesh.particles, and replaces the particles in each vertex's `follows` by their indices in that list.
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
    // A triangle is stored as a quadrangle whose last two corners are equal.
    const auto corners = [](const std::array<std::uint32_t, 4>& face) {
        return std::span(face).first(face[2] == face[3] ? 3 : 4);
    };
    mesh.first_face.assign(mesh.vertices.size() + 1, 0);
    for (const auto& face : mesh.faces) {
        for (const std::uint32_t vertex : corners(face)) ++mesh.first_face[vertex + 1];
    }
    std::partial_sum(mesh.first_face.begin(), mesh.first_face.end(), mesh.first_face.begin());
    mesh.face_of_vertex.resize(mesh.first_face.back());
    std::vector<std::uint32_t> next(mesh.first_face.begin(), mesh.first_face.end() - 1);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        for (const std::uint32_t vertex : corners(mesh.faces[f]))
            mesh.face_of_vertex[next[vertex]++] = std::uint32_t(f);
    }
}

void find_box(BodyMesh& mesh) {
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const glm::dvec3 rest(mesh.vertices[v].rest);
        mesh.low = v == 0 ? rest : glm::min(mesh.low, rest);
        mesh.high = v == 0 ? rest : glm::max(mesh.high, rest);
    }
}

}  // namespace

BodyMesh mesh_of(const Problem& problem) {
    if (problem.lattice.voxel.size() != problem.particle_count())
        throw std::runtime_error("a network that lies on no lattice has no surface to draw");
    Surface surface(problem);
    BodyMesh mesh;
    mesh.vertices = std::move(surface.vertices);
    mesh.faces = std::move(surface.faces);
    number_particles(mesh);
    list_faces_of_vertices(mesh);
    find_box(mesh);
    return mesh;
}

BodyMesh mesh_of(const std::vector<glm::dvec3>& rest,
                 const std::vector<std::array<std::uint32_t, 3>>& triangles) {
    if (triangles.size() > max_faces) refuse_so_many_faces();
    BodyMesh mesh;
    for (const glm::dvec3& place : rest) {
        mesh.particles.push_back(std::uint32_t(mesh.vertices.size()));
        mesh.vertices.push_back({glm::vec3(place), 1, {mesh.particles.back()}});
    }
    for (const auto& [a, b, c] : triangles) mesh.faces.push_back({a, b, c, c});
    list_faces_of_vertices(mesh);
    find_box(mesh);
    return mesh;
}

}  // namespace voxspring
