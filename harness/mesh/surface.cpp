#include "harness/mesh/surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <map>
#include <span>
#include <tuple>
#include <utility>

#include "harness/base/disjoint_sets.h"
#include "harness/mesh/winding.h"

namespace voxspring {
namespace {

/// An edge of a triangle. `from` is its endpoint of lower index, `to` that of higher index.
struct Side {
    std::uint32_t from, to, triangle;
    bool is_backward;  ///< in the triangle's order of corners, `to` precedes `from`
};

std::vector<Side> sides_of(const std::vector<Triangle>& triangles) {
    std::vector<Side> sides;
    sides.reserve(3 * triangles.size());
    for (std::size_t t = 0; t < triangles.size(); ++t) {
        for (std::size_t k = 0; k < 3; ++k) {
            const std::uint32_t a = triangles[t][k], b = triangles[t][(k + 1) % 3];
            sides.push_back({std::min(a, b), std::max(a, b), std::uint32_t(t), a > b});
        }
    }
    std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) {
        return std::tie(a.from, a.to, a.triangle) < std::tie(b.from, b.to, b.triangle);
    });
    return sides;
}

/// Calls visit(sides of one edge) for each edge.
template <class Visit>
void for_each_edge(const std::vector<Side>& sides, const Visit& visit) {
    for (std::size_t n = 0; n < sides.size();) {
        std::size_t end = n + 1;
        while (end < sides.size() && sides[end].from == sides[n].from && sides[end].to == sides[n].to) ++end;
        visit(std::span(sides).subspan(n, end - n));
        n = end;
    }
}

/// A set of triangles that are connected across edges which exactly two triangles share.
struct Piece {
    std::vector<std::uint32_t> triangles;
    double area = 0;
    glm::dvec3 area_vector{0}, centre{0};
    double volume = 0;  ///< positive if the triangles face outwards
    /// Whether the piece encloses a volume, rather than being a nearly flat patch. The length of area_vector,
    /// over area, is 0 for a closed piece, 1/2 for a half sphere and 1 for a flat patch.
    bool is_shell() const { return glm::length(area_vector) < 0.75 * area; }
};

class Turning {
public:
    explicit Turning(Surface& surface) : surface_(surface), triangles_(surface.triangles) {}

    void turn() {
        const std::vector<Triangle> before = triangles_;
        find_pieces();
        std::vector<Piece*> shells;
        for (Piece& piece : pieces_) {
            if (piece.is_shell()) shells.push_back(&piece);
        }
        if (shells.empty())
            shells.push_back(
                &*std::max_element(pieces_.begin(), pieces_.end(),
                                   [](const Piece& a, const Piece& b) { return a.area < b.area; }));
        turn_shells(shells);
        turn_patches(shells);
        for (std::size_t t = 0; t < before.size(); ++t) surface_.facts.turned += before[t] != triangles_[t];
    }

private:
    Corners corners(std::uint32_t t) const {
        const Triangle& triangle = triangles_[t];
        return {surface_.points[triangle[0]], surface_.points[triangle[1]], surface_.points[triangle[2]]};
    }
    void turn(std::uint32_t t) { std::swap(triangles_[t][1], triangles_[t][2]); }

    /// Finds the pieces. In each piece, turns triangles over so that all face the same side, the one that
    /// most of the piece's area faced.
    void find_pieces() {
        struct Neighbours {
            std::array<std::uint32_t, 3> triangle;
            std::array<bool, 3> is_turned;  ///< whether both triangles run along the edge in one direction
            std::uint32_t count = 0;
        };
        std::vector<Neighbours> neighbours(triangles_.size());
        for_each_edge(sides_of(triangles_), [&](std::span<const Side> edge) {
            if (edge.size() != 2) return;
            for (const std::size_t n : {0, 1}) {
                Neighbours& of = neighbours[edge[n].triangle];
                of.triangle[of.count] = edge[1 - n].triangle;
                of.is_turned[of.count++] = edge[0].is_backward == edge[1].is_backward;
            }
        });
        std::vector<bool> reached(triangles_.size()), turned(triangles_.size());
        for (std::uint32_t first = 0; first < triangles_.size(); ++first) {
            if (reached[first]) continue;
            Piece& piece = pieces_.emplace_back();
            piece.triangles = {first};
            reached[first] = true;
            double turned_area = 0;
            for (std::size_t n = 0; n < piece.triangles.size(); ++n) {
                const std::uint32_t t = piece.triangles[n];
                const Corners c = corners(t);
                const double area = glm::length(glm::cross(c[1] - c[0], c[2] - c[0])) / 2;
                piece.area += area;
                piece.centre += area * (c[0] + c[1] + c[2]) / 3.0;
                if (turned[t]) turned_area += area;
                for (std::uint32_t k = 0; k < neighbours[t].count; ++k) {
                    const std::uint32_t other = neighbours[t].triangle[k];
                    if (reached[other]) continue;
                    reached[other] = true;
                    turned[other] = turned[t] != neighbours[t].is_turned[k];
                    piece.triangles.push_back(other);
                }
            }
            const bool turn_rest = turned_area > piece.area / 2;
            for (const std::uint32_t t : piece.triangles) {
                if (turned[t] != turn_rest) turn(t);
            }
            if (piece.area > 0) piece.centre /= piece.area;
            measure(piece);
        }
    }

    void measure(Piece& piece) const {
        for (const std::uint32_t t : piece.triangles) {
            const Corners c = corners(t);
            piece.area_vector += glm::cross(c[1] - c[0], c[2] - c[0]) / 2.0;
            piece.volume +=
                glm::dot(c[0] - piece.centre, glm::cross(c[1] - piece.centre, c[2] - piece.centre)) / 6;
        }
    }

    void turn(const Piece& piece) {
        for (const std::uint32_t t : piece.triangles) turn(t);
    }

    WindingTree tree_of(const std::vector<Piece*>& pieces) const {
        std::vector<Corners> all;
        for (const Piece* piece : pieces) {
            for (const std::uint32_t t : piece->triangles) all.push_back(corners(t));
        }
        return WindingTree(std::move(all));
    }

    void turn_shells(const std::vector<Piece*>& shells) {
        double volume = 0;
        for (const Piece* shell : shells) volume += shell->volume;
        for (Piece* shell : shells) {
            if (!(volume < 0)) break;
            turn(*shell);
            shell->volume = -shell->volume;
        }
        std::vector<Piece*> inverted;
        for (Piece* shell : shells) {
            if (shell->volume < 0) inverted.push_back(shell);
        }
        if (inverted.empty()) return;
        std::vector<Piece*> others;
        for (Piece* shell : shells) {
            if (shell->volume >= 0) others.push_back(shell);
        }
        const WindingTree tree = tree_of(others);
        for (const Piece* shell : inverted) {
            // An inverted shell within another shell is a cavity, and stays. Any other inverted shell is
            // turned.
            if (tree.at(corners(shell->triangles.front())[0]) < 0.5) turn(*shell);
        }
    }

    /// Turns each patch (a piece that is no shell) so that it faces the side with the lower winding number.
    /// The winding number grows from a shell's outside to its inside.
    void turn_patches(const std::vector<Piece*>& shells) {
        std::vector<const Piece*> patches;
        for (const Piece& piece : pieces_) {
            if (std::find(shells.begin(), shells.end(), &piece) == shells.end()) patches.push_back(&piece);
        }
        if (patches.empty()) return;
        const WindingTree tree = tree_of(shells);
        std::vector<std::uint8_t> is_turned(patches.size());
#pragma omp parallel for schedule(dynamic)
        for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(patches.size()); ++n) {
            const Piece& patch = *patches[std::size_t(n)];
            constexpr std::size_t samples = 16;
            const std::size_t stride = std::max<std::size_t>(1, patch.triangles.size() / samples);
            double difference = 0;
            for (std::size_t k = 0; k < patch.triangles.size(); k += stride) {
                const Corners c = corners(patch.triangles[k]);
                const glm::dvec3 normal = glm::cross(c[1] - c[0], c[2] - c[0]);
                const double area = glm::length(normal);
                if (!(area > 0)) continue;
                // Offset of the two sample points from the triangle. It grows with the patch, so that the
                // points are clear of the hole that the patch fills.
                const glm::dvec3 offset = normal / area * std::sqrt(patch.area) / 4.0;
                const glm::dvec3 centre = (c[0] + c[1] + c[2]) / 3.0;
                difference += area * (tree.at(centre + offset) - tree.at(centre - offset));
            }
            is_turned[std::size_t(n)] = difference > 0;
        }
        for (std::size_t n = 0; n < patches.size(); ++n) {
            if (is_turned[n] != 0) turn(*patches[n]);
        }
    }

    Surface& surface_;
    std::vector<Triangle>& triangles_;
    std::vector<Piece> pieces_;
};

/// Closes the surface: adds a fan of triangles over each connected set of unbalanced edges, which more
/// triangles pass in one direction than in the other.
void add_caps(Surface& surface) {
    DisjointSets sets(surface.points.size());
    std::vector<Triangle> open;  // triangles of the caps, at first without their third point
    for_each_edge(sides_of(surface.triangles), [&](std::span<const Side> edge) {
        std::int64_t net = 0;
        for (const Side& side : edge) net += side.is_backward ? -1 : 1;
        if (edge.size() == 1) ++surface.facts.open_edges;
        if (edge.size() > 2) ++surface.facts.non_manifold_edges;
        if (net == 0) return;
        sets.join(edge[0].from, edge[0].to);
        // A cap passes the edge in the direction opposite to the surface's triangles.
        for (; net > 0; --net) open.push_back({edge[0].to, edge[0].from, 0});
        for (; net < 0; ++net) open.push_back({edge[0].from, edge[0].to, 0});
    });
    // For each set of edges: the index of its cap's point, and the number of ends of edges that were added up
    // there.
    std::map<std::uint32_t, std::pair<std::uint32_t, double>> apex;
    for (const Triangle& edge : open) {
        const auto [found, is_new] = apex.try_emplace(sets.of(edge[0]), surface.points.size(), 0.0);
        if (is_new) surface.points.emplace_back(0);
        auto& [point, count] = found->second;
        surface.points[point] += surface.points[edge[0]] + surface.points[edge[1]];
        count += 2;
    }
    for (const auto& [set, cap] : apex) surface.points[cap.first] /= cap.second;
    for (Triangle& edge : open) edge[2] = apex.at(sets.of(edge[0])).first;
    surface.facts.holes = apex.size();
    surface.caps = std::move(open);
}

}  // namespace

Surface surface_of(const Mesh& mesh) {
    Surface surface;
    surface.points = mesh.points;
    MeshFacts& facts = surface.facts;
    facts.tetrahedra = mesh.tetrahedra.size();
    facts.triangles = mesh.triangles.size();
    const std::vector<std::uint32_t> first = welded(mesh.points);
    std::vector<bool> used(mesh.points.size());
    DisjointSets parts(mesh.points.size());
    for (const Triangle& triangle : mesh.triangles) {
        const Triangle same = {first[triangle[0]], first[triangle[1]], first[triangle[2]]};
        for (const std::uint32_t point : same) {
            facts.low = facts.vertices == 0 ? mesh.points[point] : glm::min(facts.low, mesh.points[point]);
            facts.high = facts.vertices == 0 ? mesh.points[point] : glm::max(facts.high, mesh.points[point]);
            facts.vertices += used[point] ? 0 : 1;
            used[point] = true;
        }
        parts.join(same[0], same[1]);
        parts.join(same[0], same[2]);
        const auto& p = mesh.points;
        if (same[0] == same[1] || same[1] == same[2] || same[0] == same[2]) {
            ++facts.flat;  // not added to the surface, where its edges would count as open
            continue;
        }
        if (glm::cross(p[same[1]] - p[same[0]], p[same[2]] - p[same[0]]) == glm::dvec3(0)) ++facts.flat;
        surface.triangles.push_back(same);
    }
    for (std::uint32_t n = 0; n < used.size(); ++n) facts.parts += used[n] && parts.of(n) == n;
    if (surface.triangles.empty()) return surface;
    Turning(surface).turn();
    add_caps(surface);
    const glm::dvec3 middle = (facts.low + facts.high) / 2.0;
    for (const auto* triangles : {&surface.triangles, &surface.caps}) {
        for (const auto& [a, b, c] : *triangles)
            facts.volume += glm::dot(surface.points[a] - middle,
                                     glm::cross(surface.points[b] - middle, surface.points[c] - middle)) /
                            6;
    }
    return surface;
}

}  // namespace voxspring
