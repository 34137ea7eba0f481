#include "backends/physics/problem.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numeric>
#include <utility>

#include "backends/physics/huge_pages.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"

namespace voxspring {

const std::array<Direction, neighbour_count>& directions() {
#define FACE(bit, dx, dy, dz) Direction{bit, {dx, dy, dz}, SpringGroup::face},
#define EDGE(bit, dx, dy, dz) Direction{bit, {dx, dy, dz}, SpringGroup::edge},
#define CORNER(bit, dx, dy, dz) Direction{bit, {dx, dy, dz}, SpringGroup::corner},
    static const std::array<Direction, neighbour_count> list = {FACE_NEIGHBOURS(FACE) EDGE_NEIGHBOURS(EDGE)
                                                                    CORNER_NEIGHBOURS(CORNER)};
#undef FACE
#undef EDGE
#undef CORNER
    return list;
}

glm::ivec3 Lattice::coordinates(std::uint32_t voxel_index) const {
    const auto width = std::uint32_t(dims.x);
    const auto height = std::uint32_t(dims.y);
    return {int(voxel_index % width), int(voxel_index / width % height), int(voxel_index / width / height)};
}

std::pair<std::size_t, std::size_t> Lattice::particles_between(int begin, int end) const {
    const std::size_t plane = std::size_t(dims.x) * std::size_t(dims.y);
    const auto first_from = [&](int z) {
        const auto found = std::lower_bound(voxel.begin(), voxel.end(), plane * std::size_t(std::max(z, 0)));
        return std::size_t(found - voxel.begin());
    };
    return {first_from(begin), first_from(end)};
}

std::pair<int, int> Lattice::occupied_layers(int axis) const {
    int first = dims[axis], last = 0;
#pragma omp parallel for reduction(min : first) reduction(max : last)
    for (std::ptrdiff_t i = 0; i < std::ptrdiff_t(voxel.size()); ++i) {
        const int layer = coordinates(voxel[std::size_t(i)])[axis];
        first = std::min(first, layer);
        last = std::max(last, layer);
    }
    return {first, last};
}

std::ptrdiff_t Lattice::stride(const Direction& direction) const {
    const glm::ivec3 o = direction.offset;
    return (std::ptrdiff_t(o.z) * dims.y + o.y) * dims.x + o.x;
}

double Problem::spring_stiffness(std::size_t particle, std::size_t neighbour,
                                 const Direction& direction) const {
    if (!has_materials()) return group_stiffness[std::size_t(direction.group)];
    return series_stiffness(1 / material_of(particle).stiffness, 1 / material_of(neighbour).stiffness);
}

double Problem::shortest_spacing() const {
    double shortest = std::numeric_limits<double>::infinity();
    if (lattice.voxel_count() > 0) {
        shortest = std::min({lattice.spacing.x, lattice.spacing.y, lattice.spacing.z});
    } else {
        for (const Spring& spring : springs) {
            if (spring.rest_length > 0) shortest = std::min(shortest, spring.rest_length);
        }
    }
    return std::isfinite(shortest) ? shortest : 1;
}

double Problem::shortest_squared() const {
    const double shortest = shortest_spacing();
    return 1e-12 * shortest * shortest;
}

SpringCounts count_springs(const Problem& problem) {
    const std::vector<std::uint32_t>& masks = problem.lattice.mask;
    std::uint64_t faces = 0, edges = 0, corners = 0;
#pragma omp parallel for reduction(+ : faces, edges, corners)
    for (std::ptrdiff_t i = 0; i < std::ptrdiff_t(masks.size()); ++i) {
        const std::uint32_t mask = masks[std::size_t(i)];
        faces += std::uint64_t(std::popcount(mask & FACE_BITS));
        edges += std::uint64_t(std::popcount(mask & EDGE_BITS));
        corners += std::uint64_t(std::popcount(mask & CORNER_BITS));
    }
    SpringCounts counts;
    counts.group = {faces / 2, edges / 2, corners / 2};  // each spring has two ends
    counts.beyond = problem.springs.size();
    return counts;
}

namespace {

RestSpring rest_spring(const glm::dvec3& offset, double length) {
    const double squared = glm::dot(offset, offset);
    return {offset, length, length == std::sqrt(squared) ? 0 : length * length - squared};
}

}  // namespace

RestSpring rest_spring(const Problem& problem, const Direction& direction) {
    const glm::dvec3 offset = -glm::dvec3(direction.offset) * problem.lattice.spacing;
    return rest_spring(offset, problem.rest_length[std::size_t(direction.bit)]);
}

RestSpring rest_spring(const Problem& problem, const Spring& spring) {
    return rest_spring(problem.rest_position[spring.first] - problem.rest_position[spring.second],
                       spring.rest_length);
}

std::vector<std::uint32_t> particle_of_voxel(const Lattice& lattice) {
    std::vector<std::uint32_t> particle(lattice.voxel_count(), no_particle);
#pragma omp parallel for
    for (std::ptrdiff_t i = 0; i < std::ptrdiff_t(lattice.voxel.size()); ++i)
        particle[lattice.voxel[std::size_t(i)]] = std::uint32_t(i);
    return particle;
}

LatticeSprings::LatticeSprings(const Problem& problem)
    : problem_(&problem), particle_(particle_of_voxel(problem.lattice)) {
    for (const Direction& direction : directions())
        stride_[std::size_t(direction.bit)] = problem.lattice.stride(direction);
}

namespace {

/// Calls visit(first, second, direction) for each spring of the lattice, in the order of list_springs().
template <class Visit>
void visit_lattice_springs(const Problem& problem, Visit visit) {
    const LatticeSprings springs(problem);
    for (std::size_t i = 0; i < problem.lattice.mask.size(); ++i) {
        springs.of(
            i, [&](std::uint32_t j, const Direction& direction) { visit(std::uint32_t(i), j, direction); });
    }
}

}  // namespace

std::vector<Spring> list_springs(const Problem& problem) {
    std::vector<Spring> springs;
    springs.reserve(count_springs(problem).total());
    visit_lattice_springs(problem, [&](std::uint32_t i, std::uint32_t j, const Direction& direction) {
        springs.push_back({i, j, problem.spring_stiffness(i, j, direction),
                           problem.rest_length[std::size_t(direction.bit)]});
    });
    springs.insert(springs.end(), problem.springs.begin(), problem.springs.end());
    return springs;
}

std::vector<RestSpring> list_rest_springs(const Problem& problem) {
    std::vector<RestSpring> springs;
    springs.reserve(count_springs(problem).total());
    visit_lattice_springs(problem, [&](std::uint32_t, std::uint32_t, const Direction& direction) {
        springs.push_back(rest_spring(problem, direction));
    });
    for (const Spring& spring : problem.springs) springs.push_back(rest_spring(problem, spring));
    return springs;
}

State State::in_full(std::size_t particles) const {
    const auto full = [particles](const std::vector<glm::dvec3>& list) {
        if (!list.empty()) return list;
        std::vector<glm::dvec3> zeros;
        resize_in_huge_pages(zeros, particles, glm::dvec3(0));
        return zeros;
    };
    return {full(displacement), full(increment)};
}

State state_at_rest(const Problem& problem) { return State().in_full(problem.particle_count()); }

Problem make_lattice_problem(const VoxelGrid& grid, std::uint32_t group_bits) {
    Problem problem;
    problem.group_bits = group_bits & NEIGHBOUR_BITS;
    Lattice& lattice = problem.lattice;
    lattice.dims = grid.dims;
    lattice.spacing = grid.spacing;
    for (const Direction& direction : directions()) {
        problem.rest_length[std::size_t(direction.bit)] =
            glm::length(glm::dvec3(direction.offset) * grid.spacing);
    }

    const glm::ivec3 dims = grid.dims;
    const std::size_t slice = std::size_t(dims.x) * std::size_t(dims.y);
    // The index of the first particle of each plane of voxels across z, so that planes can be filled in
    // parallel.
    std::vector<std::size_t> begin(std::size_t(dims.z) + 1);
    bool several = false;
#pragma omp parallel for reduction(|| : several)
    for (int z = 0; z < dims.z; ++z) {
        const auto label = grid.label.begin() + std::ptrdiff_t(slice) * z;
        begin[std::size_t(z) + 1] = slice - std::size_t(std::count(label, label + std::ptrdiff_t(slice), 0));
        several = several || std::any_of(label, label + std::ptrdiff_t(slice), [](auto l) { return l > 1; });
    }
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    resize_in_huge_pages(problem.rest_position, begin.back());
    resize_in_huge_pages(lattice.voxel, begin.back());
    resize_in_huge_pages(lattice.mask, begin.back());
    if (several) problem.material.resize(begin.back());
#pragma omp parallel for schedule(dynamic)
    for (int z = 0; z < dims.z; ++z) {
        std::size_t i = begin[std::size_t(z)];
        std::size_t voxel = slice * std::size_t(z);
        for (int y = 0; y < dims.y; ++y) {
            for (int x = 0; x < dims.x; ++x, ++voxel) {
                if (grid.label[voxel] == 0) continue;
                std::uint32_t mask = ACTIVE_BIT;
                for (const Direction& direction : directions()) {
                    const glm::ivec3 n = glm::ivec3(x, y, z) + direction.offset;
                    if (n.x < 0 || n.y < 0 || n.z < 0 || n.x >= dims.x || n.y >= dims.y || n.z >= dims.z)
                        continue;
                    if (grid.label[std::size_t(std::ptrdiff_t(voxel) + lattice.stride(direction))] != 0) {
                        mask |= 1u << direction.bit;
                    }
                }
                problem.rest_position[i] = glm::dvec3(x, y, z) * grid.spacing;
                lattice.voxel[i] = std::uint32_t(voxel);
                lattice.mask[i] = mask & (problem.group_bits | ACTIVE_BIT);
                if (several) problem.material[i] = std::uint8_t(grid.label[voxel] - 1);
                ++i;
            }
        }
    }
    return problem;
}

void pin(Problem& problem, std::vector<std::uint8_t> pinned) {
    const bool any = std::any_of(pinned.begin(), pinned.end(), [](auto p) { return p != 0; });
#pragma omp parallel for
    for (std::ptrdiff_t i = 0; i < std::ptrdiff_t(problem.lattice.mask.size()); ++i) {
        auto& mask = problem.lattice.mask[std::size_t(i)];
        mask = pinned[std::size_t(i)] != 0 ? mask | PINNED_BIT : mask & ~PINNED_BIT;
    }
    problem.pinned = any ? std::move(pinned) : std::vector<std::uint8_t>{};
}

void take_hold(Problem& problem, Tool tool) {
    problem.tool = std::move(tool);
    if (problem.has_tool()) problem.load.resize(problem.particle_count(), glm::dvec3(0));
}

}  // namespace voxspring
