#include "harness/mesh/carried_mesh.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <unordered_map>
#include <utility>

#include "backends/layout/boxes.h"
#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

constexpr double reach = 2.5;  // half the width of the box around a vertex, in voxels
constexpr int width = 5;       // number of voxel centres in the box, per axis
constexpr int cells = width * width * width;

/// The motion of a vertex: a displacement in the problem's unit of length, and a value.
using Motion = Eigen::Vector4d;

/// The particles in the box of width x width x width voxels around a place.
struct Box {
    std::array<std::uint32_t, cells> particle;
    std::array<glm::dvec3, cells> offset;  ///< from the place to the particle, in voxels
    int nearest = -1;                      ///< cell of the nearest particle; -1: the box is empty

    int cell_of(std::uint32_t i) const {
        const auto found = std::find(particle.begin(), particle.end(), i);
        return found == particle.end() ? -1 : int(found - particle.begin());
    }
};

/// For each cell of a box, whether springs connect its particle to a certain other particle of the box.
using Connected = std::array<bool, cells>;

/// A weight for the motion of each particle in the cells `of`. With these weights the sum of their motions is
/// the value, at the place that the box surrounds, of the affine motion that fits theirs best (weighted least
/// squares).
std::array<double, cells> weights(const Box& box, const Connected& of) {
    std::array<double, cells> weight{};
    double sum = 0;
    const auto offset = [&](std::size_t n) {
        return Eigen::Vector3d(box.offset[n].x, box.offset[n].y, box.offset[n].z);
    };
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (std::size_t n = 0; n < cells; ++n) {
        if (!of[n]) continue;
        double w = 1;
        for (int axis = 0; axis < 3; ++axis) {
            const double share = box.offset[n][axis] / reach;
            w *= (1 - share * share) * (1 - share * share);
        }
        weight[n] = w;
        sum += w;
        centre += w * offset(n);
    }
    if (!(sum > 0)) {
        weight[std::size_t(box.nearest)] = 1;
        return weight;
    }
    centre /= sum;
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (std::size_t n = 0; n < cells; ++n) {
        if (weight[n] > 0) spread += weight[n] * (offset(n) - centre) * (offset(n) - centre).transpose();
    }
    // The motion is taken to be constant along directions in which the particles have no extent.
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread / sum);
    // The largest extent that counts as none, in voxels squared. A second layer of particles adds more.
    constexpr double none = 1e-6;
    Eigen::Vector3d slope = Eigen::Vector3d::Zero();
    for (int k = 0; k < 3; ++k) {
        if (axes.eigenvalues()[k] <= none) continue;
        const Eigen::Vector3d axis = axes.eigenvectors().col(k);
        slope += axis * (axis.dot(centre) / axes.eigenvalues()[k]);
    }
    for (std::size_t n = 0; n < cells; ++n) {
        if (weight[n] > 0) weight[n] *= (1 - slope.dot(offset(n) - centre)) / sum;
    }
    return weight;
}

/// Policy for Carrier: an Item is the motion of a vertex in one state.
struct Motions {
    using Item = Motion;
    std::span<const glm::dvec3> displacement;
    std::span<const double> value;

    Item of_particle(std::uint32_t i) const {
        const glm::dvec3& u = displacement[i];
        return {u.x, u.y, u.z, value.empty() ? 0 : value[i]};
    }
    Item fit(const Box& box, const Connected& of) const {
        const std::array<double, cells> weight = weights(box, of);
        Motion sum = Motion::Zero();
        for (std::size_t n = 0; n < cells; ++n) {
            if (weight[n] != 0) sum += weight[n] * of_particle(box.particle[n]);
        }
        return sum;
    }
};

/// Policy for Carrier: an Item lists the particles that a vertex follows, with their weights.
struct Followed {
    using Item = std::vector<std::pair<std::uint32_t, float>>;

    static Item of_particle(std::uint32_t i) { return {{i, 1.0F}}; }
    static Item fit(const Box& box, const Connected& of) {
        const std::array<double, cells> weight = weights(box, of);
        Item item;
        for (std::size_t n = 0; n < cells; ++n) {
            if (weight[n] != 0) item.emplace_back(box.particle[n], float(weight[n]));
        }
        return item;
    }
};

/// Attaches a mesh to particles. The policy `Vertices` (Motions or Followed) determines the Item that is
/// computed for each vertex.
template <class Vertices>
class Carrier {
public:
    using Item = typename Vertices::Item;

    Carrier(const MeshInGrid& source, const Problem& problem, Vertices vertices)
        : source_(source),
          problem_(problem),
          vertices_(std::move(vertices)),
          particle_(particle_of_voxel(problem.lattice)),
          mask_(problem.lattice.mask) {
        for (const Direction& direction : directions()) {
            const auto bit = std::size_t(direction.bit);
            stride_[bit] = (direction.offset.z * width + direction.offset.y) * width + direction.offset.x;
        }
        // A suture may join neighbours by a spring that is not the lattice's. That closes the mesh as well.
        for (const Spring& spring : problem.springs) {
            const glm::ivec3 offset = problem.lattice.coordinates(problem.lattice.voxel[spring.second]) -
                                      problem.lattice.coordinates(problem.lattice.voxel[spring.first]);
            for (const Direction& direction : directions()) {
                if (direction.offset != offset) continue;
                mask_[spring.first] |= 1U << direction.bit;
                mask_[spring.second] |= 1U << (direction.bit ^ 1);
            }
        }
    }

    /// Fills `items` with the Item of each vertex, copies at cuts included. The returned mesh has no
    /// displacements yet.
    CarriedMesh carry(std::vector<Item>& items) {
        const Mesh& mesh = source_.mesh;
        CarriedMesh out{.rest = mesh.points, .triangles = mesh.triangles, .tetrahedra = mesh.tetrahedra};
        const auto count = std::ptrdiff_t(mesh.points.size());
        items.assign(mesh.points.size(), Item());
        std::vector<std::uint8_t> is_cut(mesh.points.size()), is_alone(mesh.points.size());
#pragma omp parallel for schedule(dynamic, 256)
        for (std::ptrdiff_t v = 0; v < count; ++v) {
            const auto at = std::size_t(v);
            const Box box = box_at(mesh.points[at]);
            if (box.nearest < 0) {
                is_alone[at] = 1;
                continue;
            }
            const Connected now = connected_to(box, box.nearest, true);
            items[at] = vertices_.fit(box, now);
            is_cut[at] = now != connected_to(box, box.nearest, false);
        }
        if (std::find(is_alone.begin(), is_alone.end(), 1) != is_alone.end()) follow_nearest(is_alone, items);
        part(out.triangles, is_cut, items, out);
        part(out.tetrahedra, is_cut, items, out);
        out.copies = out.rest.size() - mesh.points.size();
        return out;
    }

private:
    /// Converts a position from the mesh's coordinates to voxels, where voxel centres have integer
    /// coordinates. Positions far outside the grid are clamped to its neighbourhood.
    glm::dvec3 in_voxels(const glm::dvec3& point) const {
        return glm::clamp((point - source_.origin) / source_.pitch, glm::dvec3(-2 * width),
                          glm::dvec3(problem_.lattice.dims + 2 * width));
    }

    Box box_at(const glm::dvec3& point) const {
        const glm::ivec3 dims = problem_.lattice.dims;
        const glm::dvec3 place = in_voxels(point);
        const glm::ivec3 first = glm::ivec3(glm::floor(place + 0.5)) - width / 2;
        Box box;
        double least = std::numeric_limits<double>::infinity();
        int cell = 0;
        layout::visit_box(first, first + width, [&](const glm::ivec3& at) {
            const auto n = std::size_t(cell++);
            box.particle[n] =
                layout::has_voxel(dims, at) ? particle_[layout::index_in(dims, at)] : no_particle;
            if (box.particle[n] == no_particle) return;
            box.offset[n] = glm::dvec3(at) - place;
            const double squared = glm::dot(box.offset[n], box.offset[n]);
            if (squared < least) {
                least = squared;
                box.nearest = int(n);
            }
        });
        return box;
    }

    /// The cells that springs within the box connect to the cell `first`. If `present`, only springs that
    /// exist now count; otherwise all springs that existed before any cut.
    Connected connected_to(const Box& box, int first, bool present) const {
        Connected reached{};
        std::array<int, cells> waiting{};
        int count = 0;
        waiting[std::size_t(count++)] = first;
        reached[std::size_t(first)] = true;
        while (count > 0) {
            const int cell = waiting[std::size_t(--count)];
            const glm::ivec3 at(cell % width, cell / width % width, cell / (width * width));
            const std::uint32_t bits = present ? mask_[box.particle[std::size_t(cell)]] : problem_.group_bits;
            visit_directions(bits, [&](const Direction& direction) {
                const glm::ivec3 to = at + direction.offset;
                if (std::min({to.x, to.y, to.z}) < 0 || std::max({to.x, to.y, to.z}) >= width) return;
                const int next = cell + stride_[std::size_t(direction.bit)];
                if (reached[std::size_t(next)] || box.particle[std::size_t(next)] == no_particle) return;
                reached[std::size_t(next)] = true;
                waiting[std::size_t(count++)] = next;
            });
        }
        return reached;
    }

    /// Makes each vertex that has no particle in its box (`is_alone`) follow the nearest particle. A flood
    /// fill from the particles through the voxels finds the nearest one.
    void follow_nearest(const std::vector<std::uint8_t>& is_alone, std::vector<Item>& items) const {
        const glm::ivec3 dims = problem_.lattice.dims;
        std::vector<std::uint32_t> nearest = particle_, front = problem_.lattice.voxel, next;
        for (; !front.empty(); front.swap(next)) {
            next.clear();
            for (const std::uint32_t voxel : front) {
                const glm::ivec3 at = problem_.lattice.coordinates(voxel);
                for (int axis = 0; axis < 3; ++axis) {
                    for (const int step : {-1, 1}) {
                        glm::ivec3 to = at;
                        to[axis] += step;
                        if (to[axis] < 0 || to[axis] >= dims[axis]) continue;
                        const auto there = std::uint32_t(layout::index_in(dims, to));
                        if (nearest[there] != no_particle) continue;
                        nearest[there] = nearest[voxel];
                        next.push_back(there);
                    }
                }
            }
        }
        for (std::size_t v = 0; v < is_alone.size(); ++v) {
            if (is_alone[v] == 0) continue;
            const glm::ivec3 at = glm::clamp(glm::ivec3(glm::floor(in_voxels(source_.mesh.points[v]) + 0.5)),
                                             glm::ivec3(0), dims - 1);
            items[v] = vertices_.of_particle(nearest[layout::index_in(dims, at)]);
        }
    }

    /// Separates the mesh at cuts: where two sides of a cut share a vertex, makes the triangles or tetrahedra
    /// of one side use a copy of that vertex. Appends the copies to `items` and `out.rest`.
    template <class Cell>
    void part(std::vector<Cell>& all, const std::vector<std::uint8_t>& is_cut, std::vector<Item>& items,
              CarriedMesh& out) {
        for (Cell& cell : all) {
            if (std::none_of(cell.begin(), cell.end(), [&](std::uint32_t v) { return is_cut[v] != 0; }))
                continue;
            glm::dvec3 centroid(0);
            for (const std::uint32_t v : cell) centroid += source_.mesh.points[v] / double(cell.size());
            const Box around = box_at(centroid);
            if (around.nearest < 0) continue;
            const std::uint32_t guide = around.particle[std::size_t(around.nearest)];
            for (std::uint32_t& v : cell) {
                if (is_cut[v] != 0) v = vertex_beside(v, guide, items, out);
            }
        }
    }

    /// The vertex that a triangle or tetrahedron uses for `v` if it follows the particle `guide`: `v`, or its
    /// copy across a cut.
    std::uint32_t vertex_beside(std::uint32_t v, std::uint32_t guide, std::vector<Item>& items,
                                CarriedMesh& out) {
        const Box box = box_at(source_.mesh.points[v]);
        const int cell = box.cell_of(guide);
        if (cell < 0 || connected_to(box, box.nearest, true)[std::size_t(cell)] ||
            !connected_to(box, box.nearest, false)[std::size_t(cell)])
            return v;
        const Connected side = connected_to(box, cell, true);
        // The first particle of a side of a cut identifies this side.
        const auto first = std::size_t(std::find(side.begin(), side.end(), true) - side.begin());
        const std::uint64_t name = std::uint64_t(v) << 32U | box.particle[first];
        const auto [copy, is_new] = copies_.try_emplace(name, std::uint32_t(out.rest.size()));
        if (is_new) {
            out.rest.push_back(source_.mesh.points[v]);
            items.push_back(vertices_.fit(box, side));
        }
        return copy->second;
    }

    const MeshInGrid& source_;
    const Problem& problem_;
    Vertices vertices_;
    std::vector<std::uint32_t> particle_;  ///< the particle in each voxel, or no_particle
    std::vector<std::uint32_t> mask_;      ///< Lattice::mask with the springs beyond the lattice
    std::array<int, neighbour_count> stride_{};
    std::unordered_map<std::uint64_t, std::uint32_t> copies_;
};

}  // namespace

CarriedMesh carried(const MeshInGrid& source, const Problem& problem,
                    std::span<const glm::dvec3> displacement, std::span<const double> value) {
    std::vector<Motion> motion;
    CarriedMesh out = Carrier(source, problem, Motions{displacement, value}).carry(motion);
    const double scale = source.pitch / problem.lattice.spacing.x;
    for (const Motion& m : motion) {
        out.displacement.emplace_back(scale * m[0], scale * m[1], scale * m[2]);
        if (!value.empty()) out.value.push_back(m[3]);
    }
    return out;
}

BoundMesh::BoundMesh(const MeshInGrid& source, const Problem& problem) {
    std::vector<Followed::Item> items;
    CarriedMesh mesh = Carrier(source, problem, Followed{}).carry(items);
    const double scale = problem.lattice.spacing.x / source.pitch;
    for (const glm::dvec3& point : mesh.rest) rest.push_back(scale * (point - source.origin));
    triangles = std::move(mesh.triangles);
    first_.reserve(items.size() + 1);
    for (const Followed::Item& item : items) {
        first_.push_back(followed_.size());
        followed_.insert(followed_.end(), item.begin(), item.end());
    }
    first_.push_back(followed_.size());
}

template <class Value>
std::vector<Value> BoundMesh::at_vertices(std::span<const Value> of_particles) const {
    std::vector<Value> all(rest.size());
    const auto count = std::ptrdiff_t(all.size());
#pragma omp parallel for
    for (std::ptrdiff_t v = 0; v < count; ++v) {
        Value sum(0);
        for (std::size_t n = first_[std::size_t(v)]; n < first_[std::size_t(v) + 1]; ++n)
            sum += double(followed_[n].second) * of_particles[followed_[n].first];
        all[std::size_t(v)] = sum;
    }
    return all;
}

template std::vector<glm::dvec3> BoundMesh::at_vertices(std::span<const glm::dvec3>) const;
template std::vector<double> BoundMesh::at_vertices(std::span<const double>) const;

}  // namespace voxspring
