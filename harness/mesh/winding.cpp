#include "harness/mesh/winding.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <numbers>
#include <utility>

namespace voxspring {
namespace {

glm::dvec3 centroid(const Corners& t) { return (t[0] + t[1] + t[2]) / 3.0; }
glm::dvec3 area_vector(const Corners& t) { return glm::cross(t[1] - t[0], t[2] - t[0]) / 2.0; }

/// A node stands for all its triangles at points that are farther from its centre than this many times its
/// reach.
constexpr double far_away = 3;
constexpr std::uint32_t leaf_size = 8;

}  // namespace

double winding_of(const Corners& triangle, const glm::dvec3& point) {
    const glm::dvec3 a = triangle[0] - point, b = triangle[1] - point, c = triangle[2] - point;
    const double la = glm::length(a), lb = glm::length(b), lc = glm::length(c);
    const double volume = glm::dot(a, glm::cross(b, c));
    const double projected = la * lb * lc + glm::dot(a, b) * lc + glm::dot(b, c) * la + glm::dot(c, a) * lb;
    return volume == 0 ? 0 : std::atan2(volume, projected) / (2 * std::numbers::pi);
}

WindingTree::WindingTree(std::vector<Corners> triangles) : triangles_(std::move(triangles)) {
    if (!triangles_.empty()) build(0, std::uint32_t(triangles_.size()));
}

void WindingTree::build(std::uint32_t first, std::uint32_t count) {
    const std::size_t here = nodes_.size();
    Node node{.first = first, .count = count};
    const auto begin = triangles_.begin() + first, end = begin + count;
    glm::dvec3 low = begin->front(), high = low;
    double whole = 0;
    for (auto t = begin; t != end; ++t) {
        const double area = glm::length(area_vector(*t));
        node.centre += area * centroid(*t);
        node.area += area_vector(*t);
        whole += area;
        for (const glm::dvec3& corner : *t) {
            low = glm::min(low, corner);
            high = glm::max(high, corner);
        }
    }
    node.centre = whole > 0 ? node.centre / whole : (low + high) / 2.0;
    for (auto t = begin; t != end; ++t) {
        for (const glm::dvec3& corner : *t)
            node.reach = std::max(node.reach, glm::distance(corner, node.centre));
    }
    nodes_.push_back(node);
    if (count <= leaf_size) return;
    const glm::dvec3 extent = high - low;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    std::nth_element(begin, begin + count / 2, end, [axis](const Corners& a, const Corners& b) {
        return centroid(a)[axis] < centroid(b)[axis];
    });
    build(first, count / 2);
    nodes_[here].right = std::uint32_t(nodes_.size());
    build(first + count / 2, count - count / 2);
}

double WindingTree::at(const glm::dvec3& point) const {
    if (nodes_.empty()) return 0;
    std::array<std::uint32_t, 64> waiting{};  // stack of nodes; its depth is enough for 2^32 triangles
    std::size_t count = 1;
    double sum = 0;
    while (count > 0) {
        const std::uint32_t n = waiting[--count];
        const Node& node = nodes_[n];
        const glm::dvec3 to = node.centre - point;
        const double distance = glm::length(to);
        if (distance > far_away * node.reach) {
            sum += glm::dot(node.area, to) / (distance * distance * distance) / (4 * std::numbers::pi);
        } else if (node.right == 0) {
            for (std::uint32_t t = 0; t < node.count; ++t)
                sum += winding_of(triangles_[node.first + t], point);
        } else {
            waiting[count++] = node.right;
            waiting[count++] = n + 1;
        }
    }
    return sum;
}

}  // namespace voxspring
