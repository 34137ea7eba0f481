// Meshes whose volume is known, and files of them.
#pragma once

#include <algorithm>
#include <functional>
#include <glm/geometric.hpp>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "harness/mesh/mesh.h"

namespace voxspring::testing {

/// The box from 0 to `size`, of twelve triangles. Vertex n is at the corner whose bits are n, x lowest.
inline Mesh box_mesh(const glm::dvec3& size = glm::dvec3(1), const glm::dvec3& at = glm::dvec3(0)) {
    Mesh mesh{.file = "box.obj"};
    for (int n = 0; n < 8; ++n) mesh.points.push_back(at + size * glm::dvec3(n & 1, n >> 1 & 1, n >> 2));
    for (const auto& [a, b, c, d] : {std::array<std::uint32_t, 4>{0, 2, 3, 1},
                                     {4, 5, 7, 6},
                                     {0, 1, 5, 4},
                                     {2, 6, 7, 3},
                                     {0, 4, 6, 2},
                                     {1, 3, 7, 5}}) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
    }
    return mesh;
}

/// A mesh whose triangles are each cut into four, `times` times. `move` gives each new vertex its place.
inline Mesh divided(Mesh mesh, int times, const std::function<glm::dvec3(glm::dvec3)>& move = {}) {
    for (; times > 0; --times) {
        std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
        const auto between = [&](std::uint32_t a, std::uint32_t b) {
            const auto [found, is_new] = middle.try_emplace(std::minmax(a, b), mesh.points.size());
            if (is_new) mesh.points.push_back((mesh.points[a] + mesh.points[b]) / 2.0);
            return found->second;
        };
        std::vector<Triangle> all;
        for (const auto& [a, b, c] : mesh.triangles) {
            const std::uint32_t ab = between(a, b), bc = between(b, c), ca = between(c, a);
            for (const Triangle& t : {Triangle{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}})
                all.push_back(t);
        }
        mesh.triangles = std::move(all);
    }
    if (move) {
        for (glm::dvec3& p : mesh.points) p = move(p);
    }
    return mesh;
}

/// A polyhedron of 12 * 4^times triangles in a ball of radius 1 around the origin, made of a box.
inline Mesh ball_mesh(int times) {
    return divided(box_mesh(glm::dvec3(2), glm::dvec3(-1)), times,
                   [](const glm::dvec3& p) { return glm::normalize(p); });
}

inline void append(Mesh& mesh, const Mesh& other) {
    const auto first = std::uint32_t(mesh.points.size());
    mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
    for (const auto& [a, b, c] : other.triangles) mesh.triangles.push_back({a + first, b + first, c + first});
}

inline void turn_over(Mesh& mesh) {
    for (Triangle& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
}

/// By the divergence theorem, exact for a closed mesh.
inline double volume_of(const Mesh& mesh) {
    double volume = 0;
    for (const auto& [a, b, c] : mesh.triangles)
        volume += glm::dot(mesh.points[a], glm::cross(mesh.points[b], mesh.points[c])) / 6;
    return volume;
}

template <class Number>
void put(std::string& bytes, Number number, bool big_endian = false) {
    auto* first = reinterpret_cast<char*>(&number);
    if (big_endian) std::reverse(first, first + sizeof number);
    bytes.append(first, sizeof number);
}

}  // namespace voxspring::testing
