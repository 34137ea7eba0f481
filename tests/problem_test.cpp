// The lattice: counts, masks, rest lengths, stiffnesses, pins.
#include "backends/physics/problem.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <map>
#include <set>
#include <utility>

#include "tests/support.h"

namespace voxspring::testing {
namespace {

// The paper's Table 1 prints 280240 springs for this box; face + edge can be no more than 279744.
TEST(Counts, OfThePapersBox) {
    const SpringCounts counts = count_springs(make_lattice_problem(solid({32, 32, 32}), NEIGHBOUR_BITS));
    EXPECT_EQ(counts.group[0], 95232u);
    EXPECT_EQ(counts.group[1], 184512u);
    EXPECT_EQ(counts.group[2], 119164u);
    EXPECT_EQ(counts.group[0] + counts.group[1], 279744u);
    EXPECT_EQ(counts.beyond, 0u);
    EXPECT_EQ(counts.total(), 279744u + 119164u);
}

TEST(Counts, OfTheGroupsChosenAlone) {
    const SpringCounts counts =
        count_springs(make_lattice_problem(solid({32, 32, 32}), FACE_BITS | CORNER_BITS));
    EXPECT_EQ(counts.group[0], 95232u);
    EXPECT_EQ(counts.group[1], 0u);
    EXPECT_EQ(counts.group[2], 119164u);
}

TEST(Counts, OfBoxesTooThinForSomeGroups) {
    EXPECT_EQ(count_springs(make_lattice_problem(solid({1, 1, 1}), NEIGHBOUR_BITS)).total(), 0u);
    EXPECT_EQ(count_springs(make_lattice_problem(solid({1, 7, 1}), NEIGHBOUR_BITS)).total(), 6u);
    const SpringCounts sheet = count_springs(make_lattice_problem(solid({5, 1, 4}), NEIGHBOUR_BITS));
    EXPECT_EQ(sheet.group[0], 4u * 4 + 5 * 3);
    EXPECT_EQ(sheet.group[1], 2u * 4 * 3);
    EXPECT_EQ(sheet.group[2], 0u);
}

TEST(Counts, SpringsBeyondTheLatticeComeOnTop) {
    Problem problem = make_lattice_problem(solid({3, 1, 1}), FACE_BITS);
    problem.springs = {{0, 2, 0.5, 2.0}};
    EXPECT_EQ(count_springs(problem).beyond, 1u);
    const auto springs = list_springs(problem);
    ASSERT_EQ(springs.size(), 3u);
    EXPECT_EQ(springs.back().first, 0u);
    EXPECT_EQ(springs.back().second, 2u);
    EXPECT_EQ(springs.back().stiffness, 0.5);
    EXPECT_EQ(springs.back().rest_length, 2.0);
}

TEST(Directions, OppositeBitsPointOppositeWaysAndEvenOnesDown) {
    std::set<std::array<int, 3>> offsets;
    for (const Direction& direction : directions()) {
        const glm::ivec3 o = direction.offset;
        EXPECT_EQ(o, -directions()[std::size_t(direction.bit) ^ 1].offset) << "bit " << direction.bit;
        EXPECT_EQ(&direction, &directions()[std::size_t(direction.bit)]);
        EXPECT_EQ(std::abs(o.x) + std::abs(o.y) + std::abs(o.z), 1 + int(direction.group));
        const bool down = o.z != 0 ? o.z < 0 : o.y != 0 ? o.y < 0 : o.x < 0;
        EXPECT_EQ(down, direction.bit % 2 == 0) << "bit " << direction.bit;
        offsets.insert({o.x, o.y, o.z});
    }
    EXPECT_EQ(offsets.size(), 26u);
}

TEST(Masks, SayExactlyWhichNeighboursAreActive) {
    const VoxelGrid grid = random_grid({9, 7, 8}, 0.5, 11);
    const Problem problem = make_lattice_problem(grid, NEIGHBOUR_BITS);
    const Lattice& lattice = problem.lattice;
    const auto active = [&](glm::ivec3 c) {
        const glm::ivec3 d = grid.dims;
        return c.x >= 0 && c.y >= 0 && c.z >= 0 && c.x < d.x && c.y < d.y && c.z < d.z &&
               grid.label[(std::size_t(c.z) * d.y + c.y) * d.x + c.x] != 0;
    };
    const auto particle = particle_of_voxel(lattice);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const glm::ivec3 c = lattice.coordinates(lattice.voxel[i]);
        EXPECT_EQ(problem.rest_position[i], glm::dvec3(c));
        EXPECT_EQ(particle[lattice.voxel[i]], i);
        EXPECT_NE(lattice.mask[i] & ACTIVE_BIT, 0u);
        for (const Direction& direction : directions()) {
            const bool has = (lattice.mask[i] >> direction.bit & 1u) != 0;
            ASSERT_EQ(has, active(c + direction.offset)) << "particle " << i << " bit " << direction.bit;
            if (!has) continue;
            const auto j = particle[std::size_t(lattice.voxel[i] + lattice.stride(direction))];
            ASSERT_NE(j, no_particle);
            EXPECT_EQ(lattice.coordinates(lattice.voxel[j]), c + direction.offset);
            EXPECT_NE(lattice.mask[j] >> (direction.bit ^ 1) & 1u, 0u) << "the neighbour does not see it";
        }
    }
}

TEST(Springs, AreListedOnceWithTheLengthBetweenTheirEnds) {
    const Problem problem = make_lattice_problem(random_grid({9, 7, 8}, 0.6, 12), NEIGHBOUR_BITS);
    const auto springs = list_springs(problem);
    std::set<std::pair<std::uint32_t, std::uint32_t>> ends;
    SpringCounts counts;
    for (const Spring& spring : springs) {
        EXPECT_LT(spring.first, spring.second);
        ends.emplace(spring.first, spring.second);
        const glm::dvec3 offset = problem.rest_position[spring.second] - problem.rest_position[spring.first];
        EXPECT_EQ(spring.rest_length, glm::length(offset));
        ++counts.group[std::size_t(std::lround(glm::dot(offset, offset))) - 1];
    }
    EXPECT_EQ(ends.size(), springs.size());
    EXPECT_EQ(counts.group, count_springs(problem).group);
    EXPECT_GT(springs.size(), problem.particle_count());
}

TEST(Springs, HaveTheRestLengthOfTheirDirectionOnAnAnisotropicGrid) {
    const Problem problem = make_lattice_problem(solid({3, 3, 3}, {0.7, 1.0, 1.9}), NEIGHBOUR_BITS);
    std::map<std::array<int, 3>, double> expected = {
        {{1, 0, 0}, 0.7},
        {{0, 1, 0}, 1.0},
        {{0, 0, 1}, 1.9},
        {{1, 1, 0}, std::hypot(0.7, 1.0)},
        {{1, 0, 1}, std::hypot(0.7, 1.9)},
        {{0, 1, 1}, std::hypot(1.0, 1.9)},
        {{1, 1, 1}, std::hypot(0.7, 1.0, 1.9)},
    };
    for (const Direction& direction : directions()) {
        const glm::ivec3 o = glm::abs(direction.offset);
        EXPECT_DOUBLE_EQ(problem.rest_length[std::size_t(direction.bit)], expected.at({o.x, o.y, o.z}))
            << "bit " << direction.bit;
    }
}

TEST(Stiffness, IsTheGroupsWithOneMaterialAndInSeriesWithSeveral) {
    Problem problem = make_lattice_problem(make_grid({2, 2, 1}, [](int x, int, int) { return x + 1; }),
                                           FACE_BITS | EDGE_BITS);
    problem.materials = {{1, 4}, {1, 12}};
    ASSERT_TRUE(problem.has_materials());
    for (const Spring& spring : list_springs(problem)) {
        const double a = problem.material_of(spring.first).stiffness;
        const double b = problem.material_of(spring.second).stiffness;
        // Half a spring of each material lies in series, and half a spring has twice the stiffness.
        EXPECT_DOUBLE_EQ(spring.stiffness, 1 / (1 / (2 * a) + 1 / (2 * b)));
    }
    problem = make_lattice_problem(solid({2, 2, 2}), NEIGHBOUR_BITS);
    problem.group_stiffness = {3, 5, 7};
    EXPECT_FALSE(problem.has_materials());
    for (const Spring& spring : list_springs(problem)) {
        EXPECT_EQ(spring.stiffness, spring.rest_length < 1.2 ? 3 : spring.rest_length < 1.6 ? 5 : 7);
    }
}

TEST(Pins, KeepMasksAndListInStep) {
    Problem problem = make_lattice_problem(solid({3, 2, 1}), FACE_BITS);
    const auto unpinned = problem.lattice.mask;
    pin(problem, {1, 0, 0, 0, 1, 0});
    for (std::size_t i = 0; i < 6; ++i) {
        EXPECT_EQ(problem.is_pinned(i), i == 0 || i == 4);
        EXPECT_EQ((problem.lattice.mask[i] & PINNED_BIT) != 0, problem.is_pinned(i));
        EXPECT_EQ(problem.lattice.mask[i] & ~PINNED_BIT, unpinned[i]);
    }
    pin(problem, {0, 0, 0, 0, 0, 0});
    EXPECT_TRUE(problem.pinned.empty());
    EXPECT_EQ(problem.lattice.mask, unpinned);
}

TEST(Layers, AreFoundByPlanesAndAlongEachAxis) {
    VoxelGrid grid = solid({3, 4, 6});
    const auto clear = [&](int x, int y, int z) { grid.label[std::size_t((z * 4 + y) * 3 + x)] = 0; };
    for (int y = 0; y < 4; ++y) {
        for (int x = 0; x < 3; ++x) {
            clear(x, y, 0);
            clear(x, y, 3);
        }
    }
    clear(1, 1, 2);
    for (int z = 0; z < 6; ++z) {
        for (int y = 0; y < 4; ++y) clear(2, y, z);
    }
    const Lattice lattice = make_lattice_problem(grid, FACE_BITS).lattice;
    using Range = std::pair<std::size_t, std::size_t>;
    EXPECT_EQ(lattice.particles_between(-1, 1), Range(0, 0)) << "the first plane is empty";
    EXPECT_EQ(lattice.particles_between(1, 2), Range(0, 8));
    EXPECT_EQ(lattice.particles_between(2, 4), Range(8, 15)) << "a hole, and an empty plane";
    EXPECT_EQ(lattice.particles_between(4, 99), Range(15, 31));
    EXPECT_EQ(lattice.occupied_layers(0), std::pair(0, 1));
    EXPECT_EQ(lattice.occupied_layers(1), std::pair(0, 3));
    EXPECT_EQ(lattice.occupied_layers(2), std::pair(1, 5));
}

TEST(ShortestSquared, IsAMillionthOfTheShortestLength) {
    Problem problem = make_lattice_problem(solid({2, 2, 2}, {0.5, 2, 3}), FACE_BITS);
    EXPECT_DOUBLE_EQ(problem.shortest_squared(), 0.25e-12);
    problem = {};
    problem.rest_position.resize(2);
    problem.springs = {{0, 1, 1, 0.0}, {0, 1, 1, 4.0}};
    EXPECT_DOUBLE_EQ(problem.shortest_squared(), 16e-12);
    problem.springs = {{0, 1, 1, 0.0}};
    EXPECT_GT(problem.shortest_squared(), 0);
}

}  // namespace
}  // namespace voxspring::testing
