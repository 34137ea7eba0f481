// The divergence monitor, on every backend: what it finds and when, and that it does not change the run.
#include <gtest/gtest.h>

#include <limits>

#include "backends/registry.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

class Monitored : public BackendTest {
protected:
    Monitored() : problem(make_lattice_problem(random_grid({37, 9, 8}, 0.5, 61), FACE_BITS | EDGE_BITS)) {
        problem.time_step = 0.2;
        problem.damping = 0.01;
    }

    Problem problem;
};

TEST_P(Monitored, ARunWithinItsBoundsDoesNotDiverge) {
    backend->monitor({.largest_increment = 1, .every = 1});
    backend->upload(problem, random_state(problem, 0.05, 62));
    EXPECT_FALSE(backend->divergence().has_value());
    backend->step(20);
    EXPECT_FALSE(backend->divergence().has_value());
}

TEST_P(Monitored, FindsTheFirstCheckAtWhichAParticleIsNotFinite) {
    backend->monitor({.largest_increment = 1, .every = 4});
    State start = random_state(problem, 0.05, 63);
    start.displacement.back().y = std::numeric_limits<double>::quiet_NaN();
    backend->upload(problem, start);
    backend->step(3);
    EXPECT_FALSE(backend->divergence().has_value());
    backend->step(6);
    const std::optional<Divergence> divergence = backend->divergence();
    ASSERT_TRUE(divergence.has_value());
    EXPECT_EQ(divergence->last_good, 0);
    EXPECT_EQ(divergence->found, 4);
}

// Every particle falls freely: after step n it moves by n g dt^2.
TEST_P(Monitored, FindsTheChecksBetweenWhichAParticleBecameTooFast) {
    Problem falling = make_lattice_problem(
        make_grid({36, 5, 4}, [](int x, int y, int z) { return (x + y + z) % 2; }), FACE_BITS);
    falling.gravity = {0, 0, -0.01};
    falling.time_step = 1;
    struct Case {
        int every;
        Divergence divergence;
    };
    for (const Case& c : {Case{1, {10, 11}}, Case{4, {8, 12}}, Case{7, {7, 14}}}) {
        backend->monitor({.largest_increment = 0.105, .every = c.every});
        backend->upload(falling, state_at_rest(falling));
        for (const int count : {1, 5, 14}) backend->step(count);
        const std::optional<Divergence> divergence = backend->divergence();
        ASSERT_TRUE(divergence.has_value());
        EXPECT_EQ(divergence->last_good, c.divergence.last_good) << c.every;
        EXPECT_EQ(divergence->found, c.divergence.found) << c.every;
    }
}

// Without springs, forces and speed nothing may move: the largest increment is 0.
TEST_P(Monitored, WhatMayNotMoveDoesNotDivergeAtRest) {
    Problem apart = make_lattice_problem(
        make_grid({36, 5, 4}, [](int x, int y, int z) { return (x + y + z) % 2; }), FACE_BITS);
    apart.time_step = 1;
    backend->monitor({.largest_increment = 0, .every = 1});
    State start = state_at_rest(apart);
    backend->upload(apart, start);
    backend->step(3);
    EXPECT_FALSE(backend->divergence().has_value());
    start.increment[5].y = 1e-3;
    backend->upload(apart, start);
    backend->step(3);
    EXPECT_TRUE(backend->divergence().has_value());
}

TEST_P(Monitored, OnlyTheNextUploadTakesAMonitor) {
    State start = random_state(problem, 0.05, 64);
    start.increment[3].x = 5;
    backend->upload(problem, start);
    backend->monitor({.largest_increment = 1, .every = 1});
    backend->step(2);
    EXPECT_FALSE(backend->divergence().has_value());
    backend->upload(problem, start);
    backend->step(2);
    EXPECT_TRUE(backend->divergence().has_value());
    backend->upload(problem, state_at_rest(problem));
    backend->step(2);
    EXPECT_FALSE(backend->divergence().has_value());
}

TEST_P(Monitored, CheckingChangesNoBit) {
    const State start = random_state(problem, 0.05, 65);
    const auto run = [&](int every) {
        backend->monitor({.largest_increment = 1, .every = every});
        return stepped(*backend, problem, start, 23);
    };
    if (!backend->capabilities().deterministic) GTEST_SKIP() << "two runs differ anyway";
    const State unseen = run(0), seen = run(3);
    expect_same_bits(unseen, seen);
}

INSTANTIATE_TEST_SUITE_P(Backends, Monitored, ::testing::ValuesIn(in_every_formulation()), test_name);

}  // namespace
}  // namespace voxspring::testing
