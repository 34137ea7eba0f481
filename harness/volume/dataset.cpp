#include "harness/volume/dataset.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <random>
#include <string>

#include "harness/base/bad_input.h"
#include "harness/base/memory.h"

namespace voxspring {
namespace {

// The sides of the box in which the heart phantom is designed, lengths within that box, and `size`, a factor
// of its semi-axes and radii. x runs from the atria to the apex.
constexpr glm::dvec3 design{60, 51, 46};
constexpr double wall = 1.1285;
constexpr double size = 0.9121;
constexpr double valve_plane = 20.13;
constexpr double septum = 2 * wall;  // thickness of the wall between atria and ventricles

double square(double x) { return x * x; }

struct Ellipsoid {
    glm::dvec3 centre;
    glm::dvec3 semi_axes;

    bool contains(const glm::dvec3& p) const {
        const glm::dvec3 d = (p - centre) / semi_axes;
        return d.x * d.x + d.y * d.y + d.z * d.z <= 1;
    }
};

/// A wall, between its outer and its inner surface.
template <class Shape>
struct Hollow {
    Shape outer, inner;
};

Hollow<Ellipsoid> chamber(glm::dvec3 centre, glm::dvec3 relative_axes, double walls) {
    const glm::dvec3 axes = size * relative_axes;
    return {{centre, axes}, {centre, axes - walls * wall}};
}

/// A tube along x, described by its cross section.
struct Tube {
    double y, z, radius;

    bool contains(const glm::dvec3& p) const { return square(p.y - y) + square(p.z - z) <= square(radius); }
};

Hollow<Tube> vessel(double y, double z, double relative_radius, double walls) {
    const double radius = size * relative_radius;
    return {{y, z, radius}, {y, z, radius - walls * wall}};
}

bool in_heart(const glm::dvec3& p) {
    static const auto left_ventricle = chamber({33.37, 32.11, 22.71}, {24.6, 16.2, 18.2}, 5.6);
    static const auto right_ventricle = chamber({31.23, 17.59, 23.17}, {23.0, 16.2, 20.6}, 2.7);
    static const auto left_atrium = chamber({12.41, 34.27, 17.33}, {11.0, 14.6, 15.0}, 2.1);
    static const auto right_atrium = chamber({12.83, 16.71, 24.57}, {11.0, 14.6, 16.4}, 2.1);
    static const auto aorta = vessel(29.31, 34.73, 6.3, 2.2);
    static const auto pulmonary_artery = vessel(16.63, 38.21, 5.7, 2.0);
    static const Tube mitral_valve{34.5, 17.5, 4.7 * size};
    static const Tube tricuspid_valve{12.5, 22.5, 4.7 * size};

    const bool behind_plane = p.x >= valve_plane;
    const bool vessels = p.x >= 1 && p.x < valve_plane + septum &&
                         (aorta.outer.contains(p) || pulmonary_artery.outer.contains(p));
    const bool ventricles =
        behind_plane && (left_ventricle.outer.contains(p) || right_ventricle.outer.contains(p));
    const bool atria =
        p.x < valve_plane + septum / 2 && (left_atrium.outer.contains(p) || right_atrium.outer.contains(p));
    if (!vessels && !ventricles && !atria) return false;

    if (p.x >= valve_plane + septum) {
        if (left_ventricle.inner.contains(p)) return false;
        if (right_ventricle.inner.contains(p) && !left_ventricle.outer.contains(p)) return false;
    }
    if (!behind_plane && !vessels) {
        if (left_atrium.inner.contains(p)) return false;
        if (right_atrium.inner.contains(p) && !left_atrium.outer.contains(p)) return false;
    }
    if (p.x < valve_plane + septum + 1 && (aorta.inner.contains(p) || pulmonary_artery.inner.contains(p))) {
        return false;
    }
    const bool at_valves = p.x >= valve_plane - 2 && p.x < valve_plane + septum + 2;
    return !(at_valves && (mitral_valve.contains(p) || tricuspid_valve.contains(p)));
}

}  // namespace

SceneSizeLimits SceneSizeLimits::of_this_machine() {
    const std::uint64_t bytes = memory_limit();
    constexpr std::uint64_t max = std::numeric_limits<std::uint32_t>::max();
    return {std::min(bytes / 16, max), std::min(bytes / 192, max)};
}

std::string to_string(GridSides dims) {
    return std::to_string(dims.x) + " x " + std::to_string(dims.y) + " x " + std::to_string(dims.z);
}

std::uint64_t checked_voxel_count(GridSides dims, const SceneSizeLimits& limits, std::string_view file,
                                  std::string_view key) {
    const std::string text = to_string(dims);
    for (const std::int64_t side : {dims.x, dims.y, dims.z}) {
        if (side < 1 || side > max_side)
            throw BadInput(file, key, text, "sides from 1 to " + std::to_string(max_side));
    }
    const std::uint64_t count = std::uint64_t(dims.x) * std::uint64_t(dims.y) * std::uint64_t(dims.z);
    if (count > limits.voxels) {
        throw TooLarge(
            file, key, text,
            "at most " + std::to_string(limits.voxels) + " voxels" +
                (limits.voxels == std::numeric_limits<std::uint32_t>::max() ? ", whose indices have 32 bits"
                                                                            : " on this machine") +
                ", not " + std::to_string(count));
    }
    return count;
}

std::string exceeded_limit(const glm::dvec3& sides, const SceneSizeLimits& limits) {
    if (!(sides.x * sides.y * sides.z <= double(limits.voxels)))
        return "at most " + std::to_string(limits.voxels) + " voxels fit here";
    if (std::max({sides.x, sides.y, sides.z}) > max_side)
        return "a grid has at most " + std::to_string(max_side) + " voxels along each axis";
    return {};
}

VoxelGrid make_box(glm::ivec3 dims) {
    return {dims, glm::dvec3(1),
            std::vector<std::uint8_t>(std::size_t(dims.x) * std::size_t(dims.y) * std::size_t(dims.z),
                                      std::uint8_t{1})};
}

VoxelGrid make_heart(glm::ivec3 dims) {
    VoxelGrid grid = make_box(dims);
#pragma omp parallel for schedule(dynamic)
    for (int z = 0; z < dims.z; ++z) {
        std::size_t voxel = std::size_t(z) * std::size_t(dims.y) * std::size_t(dims.x);
        for (int y = 0; y < dims.y; ++y) {
            for (int x = 0; x < dims.x; ++x, ++voxel) {
                const glm::dvec3 p = (glm::dvec3(x, y, z) + 0.5) * design / glm::dvec3(dims);
                grid.label[voxel] = in_heart(p) ? 1 : 0;
            }
        }
    }
    return grid;
}

void remove_at_random(VoxelGrid& grid, double fraction, std::uint64_t seed) {
    std::mt19937_64 generator(seed);
    // We do not use the standard's distributions, whose values differ between libraries.
    const auto limit = std::uint64_t(std::ldexp(fraction, 53));
    for (std::uint8_t& label : grid.label) {
        if (generator() >> 11 < limit) label = 0;
    }
}

}  // namespace voxspring
