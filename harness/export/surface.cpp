#include "harness/export/surface.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include "harness/export/lattice_surface.h"

namespace voxspring {
namespace {

/// `vector` scaled to `length`; 0 if `vector` is 0.
glm::dvec3 scaled(glm::dvec3 vector, double length) {
    const double own = glm::length(vector);
    return own > 0 ? vector * (length / own) : glm::dvec3(0);
}

/// Applies to `axis` the smallest rotation that takes the unit vector `from` to the direction of `to`.
glm::dvec3 turned_along(glm::dvec3 axis, glm::dvec3 from, glm::dvec3 to) {
    const glm::dvec3 direction = scaled(to, 1);
    const double squared = 1 + glm::dot(from, direction);  // twice the squared length of half the sum of both
    // Opposite directions: half a turn about `axis` is one of the possible rotations.
    return squared > 1e-9 ? axis - (glm::dot(axis, direction) / squared) * (from + direction) : axis;
}

glm::dvec3 unit(std::size_t axis) {
    glm::dvec3 vector(0);
    vector[int(axis)] = 1;
    return vector;
}

class Body {
public:
    Body(const Problem& problem, std::span<const glm::dvec3> displacement, std::span<const double> value)
        : problem_(problem), displacement_(displacement), value_(value), surface_(problem) {}

    const LatticeSurface& surface() const { return surface_; }

    /// The four vertices of a face, with their normals.
    std::array<SurfaceVertex, 4> face(const LatticeSurface::Face& face) const {
        const std::array<glm::ivec3, 4> corners = LatticeSurface::corners_of(face);
        std::array<SurfaceVertex, 4> vertices;
        for (std::size_t n = 0; n < 4; ++n) vertices[n] = corner(face.voxel, corners[n]);
        const glm::dvec3 flat = scaled(glm::cross(vertices[2].position - vertices[0].position,
                                                  vertices[3].position - vertices[1].position),
                                       1);
        const Frame frame = frame_of(face.particle, face.voxel);
        const bool cut = surface_.at(face.voxel + step(face.axis, face.direction)) != no_particle;
        for (std::size_t n = 0; n < 4; ++n) {
            glm::dvec3 smooth = cut ? flat : carried(frame, slope(face.voxel, corners[n]));
            // If the body is one voxel thick or has collapsed, its slope is no normal of this face.
            if (!(glm::dot(smooth, flat) > 0.2)) smooth = flat;
            vertices[n].normal = smooth;
        }
        return vertices;
    }

private:
    using Frame = std::array<glm::dvec3, 3>;  ///< vectors from one voxel's centre to the next along each axis

    static glm::ivec3 step(int axis, int direction) {
        glm::ivec3 offset(0);
        offset[axis] = direction;
        return offset;
    }

    glm::dvec3 place(std::uint32_t i) const { return problem_.rest_position[i] + displacement_[i]; }

    /// The frame from the differences to a particle's neighbours. An axis without neighbours is rotated with
    /// the other axes.
    Frame frame_of(std::uint32_t i, glm::ivec3 voxel) const {
        Frame frame;
        std::array<bool, 3> known{};
        const glm::dvec3 here = place(i);
        for (int a = 0; a < 3; ++a) {
            glm::dvec3 sum(0);
            int count = 0;
            for (const int direction : {-1, 1}) {
                const std::uint32_t j = surface_.at(voxel + step(a, direction));
                if (j == no_particle || surface_.is_cut(i, step(a, direction))) continue;
                sum += double(direction) * (place(j) - here);
                ++count;
            }
            known[std::size_t(a)] = count > 0;
            if (count > 0) frame[std::size_t(a)] = sum / double(count);
        }
        for (std::size_t a = 0; a < 3; ++a) {
            if (known[a]) continue;
            const std::size_t b = (a + 1) % 3;
            const std::size_t c = (a + 2) % 3;
            glm::dvec3 direction = unit(a);
            if (known[b] && known[c]) {
                direction = glm::cross(frame[b], frame[c]);
            } else if (known[b] || known[c]) {
                const std::size_t d = known[b] ? b : c;
                direction = turned_along(direction, unit(d), frame[d]);
            }
            frame[a] = scaled(direction, problem_.lattice.spacing[int(a)]);
            known[a] = true;
        }
        return frame;
    }

    /// The vertex at the corner of `voxel` towards `sign`.
    SurfaceVertex corner(glm::ivec3 voxel, glm::ivec3 sign) const {
        const LatticeSurface::Corner corner = surface_.corner(voxel, sign);
        SurfaceVertex vertex;
        double count = 0;
        for (unsigned n = 0; n < 8; ++n) {
            if ((corner.inside >> n & 1) == 0) continue;
            const std::uint32_t i = corner.particle[n];
            const glm::ivec3 from = LatticeSurface::place_of(n);
            const Frame frame = frame_of(i, voxel + sign * from);
            const glm::dvec3 offset = glm::dvec3(sign) * (corner.crossing - glm::dvec3(from));
            vertex.position += place(i) + frame[0] * offset.x + frame[1] * offset.y + frame[2] * offset.z;
            vertex.value += value_[i];
            ++count;
        }
        vertex.position /= count;
        vertex.value /= count;
        return vertex;
    }

    /// The outward gradient of the density of active voxels around a corner at rest, over its 64 nearest
    /// voxels.
    glm::dvec3 slope(glm::ivec3 voxel, glm::ivec3 sign) const {
        // Binomial weights of the voxels at -3/2, -1/2, 1/2 and 3/2 along each axis, and their differences.
        constexpr std::array<double, 4> weight = {1, 3, 3, 1};
        constexpr std::array<double, 4> change = {-1, -1, 1, 1};
        const glm::ivec3 first = voxel + (sign - glm::ivec3(1)) / 2 - glm::ivec3(1);
        glm::dvec3 sum(0);
        for (int z = 0; z < 4; ++z) {
            for (int y = 0; y < 4; ++y) {
                for (int x = 0; x < 4; ++x) {
                    if (surface_.at(first + glm::ivec3(x, y, z)) == no_particle) continue;
                    const auto [wx, wy, wz] =
                        std::array{weight[std::size_t(x)], weight[std::size_t(y)], weight[std::size_t(z)]};
                    sum -= glm::dvec3(change[std::size_t(x)] * wy * wz, wx * change[std::size_t(y)] * wz,
                                      wx * wy * change[std::size_t(z)]);
                }
            }
        }
        return sum / problem_.lattice.spacing;
    }

    /// Transforms a normal at rest by the deformation: by the cofactors of its gradient.
    glm::dvec3 carried(const Frame& frame, glm::dvec3 normal) const {
        const glm::dvec3 spacing = problem_.lattice.spacing;
        const std::array<glm::dvec3, 3> gradient = {frame[0] / spacing.x, frame[1] / spacing.y,
                                                    frame[2] / spacing.z};
        return scaled(glm::cross(gradient[1], gradient[2]) * normal.x +
                          glm::cross(gradient[2], gradient[0]) * normal.y +
                          glm::cross(gradient[0], gradient[1]) * normal.z,
                      1);
    }

    const Problem& problem_;
    std::span<const glm::dvec3> displacement_;
    std::span<const double> value_;
    LatticeSurface surface_;
};

}  // namespace

std::vector<SurfaceVertex> surface_of(const Problem& problem, std::span<const glm::dvec3> displacement,
                                      std::span<const double> value) {
    const Lattice& lattice = problem.lattice;
    if (lattice.voxel.size() != problem.particle_count()) {
        throw std::runtime_error("a network that lies on no lattice has no surface to draw");
    }
    for (std::size_t i = 0; i < displacement.size(); ++i) {
        for (int a = 0; a < 3; ++a) {
            if (std::isfinite(displacement[i][a])) continue;
            throw std::runtime_error("the displacement of particle " + std::to_string(i) +
                                     " is not finite: there is no body to draw");
        }
    }
    const Body body(problem, displacement, value);
    std::vector<SurfaceVertex> vertices;
    body.surface().visit_open_faces([&](const LatticeSurface::Face& open) {
        const auto face = body.face(open);
        vertices.insert(vertices.end(), face.begin(), face.end());
        if (vertices.size() > 4 * max_faces) {
            throw std::runtime_error("the surface has more than " + std::to_string(max_faces) +
                                     " faces, too many to draw");
        }
    });
    return vertices;
}

}  // namespace voxspring
