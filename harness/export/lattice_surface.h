// Where the surface of a body is: which faces of voxels are open, and which particles their corners follow.
// None of it depends on where the particles are.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"

namespace voxspring {

/// Of a problem on a lattice, which must outlive it.
class LatticeSurface {
public:
    explicit LatticeSurface(const Problem& problem);

    /// The particle at a voxel, which may lie outside the lattice; no_particle: none.
    std::uint32_t at(glm::ivec3 voxel) const;
    /// Whether the springs that the problem has would join particle `i` and an active neighbour, and do not.
    bool is_cut(std::uint32_t i, glm::ivec3 offset) const;

    /// A face of the particle at a voxel, on its side `direction` (-1 or 1) along `axis`.
    struct Face {
        std::uint32_t particle;
        glm::ivec3 voxel;
        int axis, direction;
    };
    /// Calls visit(face) for every face that is to be seen: between an active voxel and an inactive one, or
    /// between two active voxels whose spring is cut.
    template <class Visit>
    void visit_open_faces(Visit visit) const;
    /// Which corner of its voxel each of a face's four corners is, counter-clockwise from outside: -1 or 1
    /// along each axis.
    static std::array<glm::ivec3, 4> corners_of(const Face& face);

    /// What a corner of a voxel follows.
    struct Corner {
        std::array<std::uint32_t, 8> particle{};  ///< of the voxels around it, see place_of()
        unsigned inside = 0;  ///< bit n: springs hold particle[n] together with the voxel's own
        glm::dvec3 crossing{
            0};  ///< where the surface is, in voxels from the voxel's centre towards the corner
    };
    Corner corner(glm::ivec3 voxel, glm::ivec3 sign) const;
    /// Of the n-th voxel around a corner, in voxels from the one whose corner it is towards the corner.
    static glm::ivec3 place_of(unsigned n) { return {n & 1, n >> 1 & 1, n >> 2}; }

private:
    const Problem& problem_;
    std::vector<std::uint32_t> at_;
    std::array<std::uint32_t, 27> bits_;
};

template <class Visit>
void LatticeSurface::visit_open_faces(Visit visit) const {
    const Lattice& lattice = problem_.lattice;
    for (std::size_t n = 0; n < problem_.particle_count(); ++n) {
        const auto i = std::uint32_t(n);
        // A voxel whose face springs are all there has no open face.
        if ((lattice.mask[n] & FACE_BITS) == FACE_BITS) continue;
        const glm::ivec3 voxel = lattice.coordinates(lattice.voxel[n]);
        for (int axis = 0; axis < 3; ++axis) {
            for (const int direction : {-1, 1}) {
                glm::ivec3 offset(0);
                offset[axis] = direction;
                if (at(voxel + offset) == no_particle || is_cut(i, offset))
                    visit(Face{i, voxel, axis, direction});
            }
        }
    }
}

}  // namespace voxspring
