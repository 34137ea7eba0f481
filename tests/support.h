// Small problems and states that several tests share.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/problem.h"
#include "backends/registry.h"

namespace voxspring::testing {

/// A grid whose voxel (x, y, z) carries `label(x, y, z)`; 0 is inactive.
inline VoxelGrid make_grid(glm::ivec3 dims, const std::function<int(int, int, int)>& label,
                           glm::dvec3 spacing = glm::dvec3(1)) {
    VoxelGrid grid{dims, spacing, {}};
    for (int z = 0; z < dims.z; ++z) {
        for (int y = 0; y < dims.y; ++y) {
            for (int x = 0; x < dims.x; ++x) grid.label.push_back(std::uint8_t(label(x, y, z)));
        }
    }
    return grid;
}

inline VoxelGrid solid(glm::ivec3 dims, glm::dvec3 spacing = glm::dvec3(1)) {
    return make_grid(
        dims, [](int, int, int) { return 1; }, spacing);
}

/// Each voxel active with probability `fill`.
inline VoxelGrid random_grid(glm::ivec3 dims, double fill, unsigned seed, int labels = 1) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    std::uniform_int_distribution<int> label(1, labels);
    return make_grid(dims, [&](int, int, int) { return uniform(generator) < fill ? label(generator) : 0; });
}

/// Particles at random places in a box, on no grid, and as many random springs of random stiffness, most of
/// them stressed: springs may repeat, and a particle may have none.
inline Problem random_network(std::size_t particles, std::size_t springs, unsigned seed) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> place(0, 4), stiffness(0.01, 0.1), rest(0.5, 3);
    std::uniform_int_distribution<std::uint32_t> end(0, std::uint32_t(particles - 1));
    Problem problem;
    for (std::size_t i = 0; i < particles; ++i) {
        const double x = place(generator), y = place(generator), z = place(generator);
        problem.rest_position.push_back({x, y, z});
    }
    while (problem.springs.size() < springs) {
        const std::uint32_t a = end(generator), b = end(generator);
        if (a == b) continue;
        const double k = stiffness(generator), l = rest(generator);
        problem.springs.push_back({std::min(a, b), std::max(a, b), k, l});
    }
    return problem;
}

/// Displaces every particle by up to `amplitude` and moves it by up to a tenth of that per step; pinned
/// particles rest.
inline State random_state(const Problem& problem, double amplitude, unsigned seed) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> uniform(-amplitude, amplitude);
    const auto vector = [&] {
        const double x = uniform(generator), y = uniform(generator), z = uniform(generator);
        return glm::dvec3(x, y, z);
    };
    State state = state_at_rest(problem);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        state.displacement[i] = vector();
        if (!problem.is_pinned(i)) state.increment[i] = 0.1 * vector();
    }
    return state;
}

/// Starts with an empty list or two, and the same starts with zeros instead.
inline std::vector<std::pair<State, State>> starts_without_zeros(const State& moving, const State& rest) {
    return {{{}, rest},
            {{{}, moving.increment}, {rest.displacement, moving.increment}},
            {{moving.displacement, {}}, {moving.displacement, rest.increment}}};
}

/// The state that a backend reaches from `start`.
inline State stepped(Backend& backend, const Problem& problem, const State& start, int steps) {
    backend.upload(problem, start);
    backend.step(steps);
    return backend.download();
}
inline State stepped(const std::string& specification, const Problem& problem, const State& start,
                     int steps) {
    return stepped(*BackendSpec::parse(specification).make(), problem, start, steps);
}

inline void expect_same_bits(const State& a, const State& b) {
    EXPECT_EQ(a.displacement, b.displacement);
    EXPECT_EQ(a.increment, b.increment);
}

inline void expect_same_springs(const Problem& problem, const Problem& expected) {
    EXPECT_EQ(problem.lattice.mask, expected.lattice.mask);
    EXPECT_TRUE(problem.springs == expected.springs);
}

/// A free lattice with one corner pulled out: a wave runs into the part at rest.
struct Poked {
    Problem problem;
    State start;

    explicit Poked(glm::ivec3 dims = {64, 24, 24}, double spacing = 1)
        : problem(make_lattice_problem(solid(dims, glm::dvec3(spacing)), FACE_BITS | EDGE_BITS)) {
        problem.damping = 0.01;
        problem.time_step = 0.28;
        start = state_at_rest(problem);
        start.displacement[0] = spacing * glm::dvec3(-0.5, -0.25, 0.125);
    }
};

/// Pins the particles of the lowest slice that has any.
inline void pin_base(Problem& problem) {
    std::vector<std::uint8_t> pinned(problem.particle_count());
    const double base = problem.rest_position.front().z;
    for (std::size_t i = 0; i < pinned.size(); ++i) pinned[i] = problem.rest_position[i].z == base;
    pin(problem, std::move(pinned));
}

/// Cuts and sutures of `problem`, which they change: a plane, a patch and a ball, of which a part is sutured
/// again within the lattice. Then, if `beyond`, sutures that leave the lattice, and more of them at one
/// particle than any list has room for.
inline std::vector<SpringEdit> edit_everything(Problem& problem, bool beyond) {
    SpringEditor editor(problem);
    const glm::dvec3 middle = problem.rest_position[problem.particle_count() / 2] + glm::dvec3(0.1, 0.2, 0.3);
    const Shape plane = Plane{middle, {1, 0.2, -0.1}};
    const Shape patch = TrianglePatch{
        {{middle - glm::dvec3(9, 9, 0), middle + glm::dvec3(9, -9, 0), middle + glm::dvec3(0, 9, 0)}}};
    const Shape ball = Ball{middle, 2};
    const auto most = std::uint32_t(problem.particle_count() - 1);
    std::vector<SpringEdit> edits;
    if (beyond) {
        // A suture that needs no longer list, and is removed by the next cut.
        const std::vector<std::pair<std::uint32_t, std::uint32_t>> ends = {{0, most}};
        edits.push_back(editor.suture(ends, 0.25));
    }
    edits.push_back(editor.cut(plane));
    edits.push_back(editor.cut(patch));
    edits.push_back(editor.suture(ball, 1.5));
    edits.push_back(editor.cut(ball));
    if (beyond) {
        edits.push_back(editor.suture(plane, 2.3, 0.125));
        std::vector<std::pair<std::uint32_t, std::uint32_t>> fan;
        for (std::uint32_t i = 1; i <= 40 && i < most; ++i) fan.emplace_back(0, i);
        edits.push_back(editor.suture(fan, 0.01));
        edits.push_back(editor.cut(Ball{problem.rest_position[0], 1.2}));
    }
    edits.push_back(editor.suture(plane, 1.5));
    return edits;
}

/// `count` edits of `problem`, which they change: cuts of random springs, a few or a third of all, cuts of
/// all springs of one particle, and joins of some springs that were cut before.
inline std::vector<SpringEdit> random_edits(Problem& problem, int count, unsigned seed) {
    std::mt19937 generator(seed);
    SpringEditor editor(problem);
    std::vector<ChangedSpring> apart;
    std::vector<SpringEdit> edits;
    for (int n = 0; n < count; ++n) {
        if (n % 2 == 1) {
            std::shuffle(apart.begin(), apart.end(), generator);
            const auto kept = apart.begin() + std::ptrdiff_t(apart.size() / 2);
            edits.push_back(editor.join({kept, apart.end()}));
            apart.erase(kept, apart.end());
            continue;
        }
        const auto alone = std::uint32_t(generator() % problem.particle_count());
        const double share = n % 4 == 0 ? 0.02 : 0.33;
        std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
        for (const Spring& spring : list_springs(problem)) {
            const bool its = spring.first == alone || spring.second == alone;
            if (its || std::generate_canonical<double, 32>(generator) < share)
                pairs.emplace_back(spring.first, spring.second);
        }
        edits.push_back(editor.cut(pairs));
        apart.insert(apart.end(), edits.back().removed.begin(), edits.back().removed.end());
    }
    return edits;
}

}  // namespace voxspring::testing
