#include "harness/export/lattice_surface.h"

#include <cstddef>
#include <utility>

namespace voxspring {
namespace {

/// Numbers the 27 voxels around a voxel, itself included, from 0 to 26. Offsets are -1, 0 or 1 along each
/// axis.
std::size_t around(glm::ivec3 offset) {
    const int index = (offset.z + 1) * 9 + (offset.y + 1) * 3 + offset.x + 1;
    return std::size_t(index);
}

/// The mask bit for each number of around(). That of the voxel itself is not used.
std::array<std::uint32_t, 27> bits_by_offset() {
    std::array<std::uint32_t, 27> bits{};
    for (const Direction& direction : directions()) bits[around(direction.offset)] = 1U << direction.bit;
    return bits;
}

}  // namespace

LatticeSurface::LatticeSurface(const Problem& problem)
    : problem_(problem), at_(particle_of_voxel(problem.lattice)), bits_(bits_by_offset()) {}

std::uint32_t LatticeSurface::at(glm::ivec3 voxel) const {
    const glm::ivec3 dims = problem_.lattice.dims;
    for (int a = 0; a < 3; ++a) {
        if (voxel[a] < 0 || voxel[a] >= dims[a]) return no_particle;
    }
    return at_[(std::size_t(voxel.z) * std::size_t(dims.y) + std::size_t(voxel.y)) * std::size_t(dims.x) +
               std::size_t(voxel.x)];
}

bool LatticeSurface::is_cut(std::uint32_t i, glm::ivec3 offset) const {
    const std::uint32_t bit = bits_[around(offset)];
    return (problem_.group_bits & bit) != 0 && (problem_.lattice.mask[i] & bit) == 0;
}

std::array<glm::ivec3, 4> LatticeSurface::corners_of(const Face& face) {
    const int u = (face.axis + 1) % 3;
    const int v = (face.axis + 2) % 3;
    // Counter-clockwise from outside, because u x v points along `axis`.
    std::array<std::pair<int, int>, 4> sides = {{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}};
    if (face.direction < 0) std::swap(sides[1], sides[3]);
    std::array<glm::ivec3, 4> corners{};
    for (std::size_t n = 0; n < 4; ++n) {
        corners[n][face.axis] = face.direction;
        corners[n][u] = sides[n].first;
        corners[n][v] = sides[n].second;
    }
    return corners;
}

LatticeSurface::Corner LatticeSurface::corner(glm::ivec3 voxel, glm::ivec3 sign) const {
    Corner corner;
    for (unsigned n = 0; n < 8; ++n) corner.particle[n] = at(voxel + sign * place_of(n));
    unsigned inside = 1;
    for (unsigned reached = 1; reached != 0;) {
        unsigned next = 0;
        for (unsigned from = 0; from < 8; ++from) {
            if ((reached >> from & 1) == 0) continue;
            for (unsigned to = 0; to < 8; ++to) {
                if ((inside >> to & 1) != 0 || corner.particle[to] == no_particle) continue;
                const std::uint32_t bit = bits_[around(sign * (place_of(to) - place_of(from)))];
                if ((problem_.lattice.mask[corner.particle[from]] & bit) != 0) next |= 1U << to;
            }
        }
        inside |= next;
        reached = next;
    }
    corner.inside = inside;

    // The mean of the points where edges of the cube of eight voxel centres cross the surface.
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
    corner.crossing = crossings == 0 ? glm::dvec3(0.5) : crossing / double(crossings);
    return corner;
}

}  // namespace voxspring
