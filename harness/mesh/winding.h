// The winding number of triangles around a point: the solid angle that they fill as seen from there, divided
// by 4 pi. It is 1 inside a closed surface that is counter-clockwise from outside, and 0 outside.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

namespace voxspring {

/// The corners of a triangle.
using Corners = std::array<glm::dvec3, 3>;

/// The winding number of one triangle, exact (van Oosterom and Strackee 1983).
double winding_of(const Corners& triangle, const glm::dvec3& point);

/// Winding numbers in logarithmic time: a tree of groups of triangles, each of which acts from afar like one
/// small triangle (Barill et al., Fast Winding Numbers for Soups and Clouds, 2018).
class WindingTree {
public:
    explicit WindingTree(std::vector<Corners> triangles);

    /// The winding number of all triangles around `point`, off by less than 0.02 (mesh_test.cpp).
    double at(const glm::dvec3& point) const;

private:
    struct Node {
        glm::dvec3 centre{0};                ///< mean of the triangles' centroids, weighted by area
        double reach = 0;                    ///< largest distance of a corner from the centre
        glm::dvec3 area{0};                  ///< sum of area vectors
        std::uint32_t first = 0, count = 0;  ///< range in triangles_, including those of all nodes below
        std::uint32_t right = 0;  ///< index of the second child (the first is the next node); 0: a leaf
    };
    void build(std::uint32_t first, std::uint32_t count);

    std::vector<Corners> triangles_;
    std::vector<Node> nodes_;
};

}  // namespace voxspring
