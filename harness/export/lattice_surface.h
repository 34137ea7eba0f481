// Finds the surface of a body: the open faces of voxels, and the particles that their corners follow. It does
// not depend on where the particles are.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"

namespace voxspring {

/// The surface of a problem on a lattice. The problem must outlive this.
class LatticeSurface {
public:
    explicit LatticeSurface(const Problem& problem);

    /// The particle at a voxel, or no_particle. The voxel may lie outside the lattice.
    std::uint32_t at(glm::ivec3 voxel) const;
    /// Whether particle `i` and its active neighbour at `offset` lack the spring that the problem's spring
    /// groups would give them.
    bool is_cut(std::uint32_t i, glm::ivec3 offset) const;

    /// The face of a particle's voxel on the side `direction` (-1 or 1) along `axis`.
    struct Face {
        std::uint32_t particle;
        glm::ivec3 voxel;
        int axis, direction;
    };
    /// Calls visit(face) for every visible face: one between an active voxel and an inactive one, or between
    /// two active voxels whose spring is cut.
    template <class Visit>
    void visit_open_faces(Visit visit) const;
    /// The four corners of a face as corners of its voxel, -1 or 1 along each axis. Counter-clockwise from
    /// outside.
    static std::array<glm::ivec3, 4> corners_of(const Face& face);

    /// The particles that a corner of a voxel follows.
    struct Corner {
        /// Particles of the eight voxels around the corner, see place_of().
        std::array<std::uint32_t, 8> particle{};
        unsigned inside = 0;  ///< bit n: springs connect particle[n] to the voxel's particle
        /// Where the surface is, in voxels from the voxel\'s centre; positive is towards the corner.
        glm::dvec3 crossing{0};
    };
    Corner corner(glm::ivec3 voxel, glm::ivec3 sign) const;
    /// The offset of the n-th voxel around a corner, in voxels from the voxel whose corner it is; positive is
    /// towards the corner.
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
        // A voxel that has all its face springs has no open face.
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
