// A body in a user's hands: what holding, cutting, sewing and switching do to it, on several backends.
#include "harness/simulation/simulation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <memory>

#include "harness/export/export_formats.h"
#include "harness/export/saved_state.h"
#include "harness/scene/scene_runner.h"
#include "tests/required.h"
#include "tests/simulated_box.h"

namespace voxspring::testing {
namespace {

class SimulationOn : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override { make_or_skip(spec(), made_); }

    static BackendSpec spec() { return BackendSpec::parse(GetParam()); }
    static Simulation start(Scene scene = box()) { return {std::move(scene), spec()}; }
    static bool is_double() { return spec().options.precision == Precision::float64; }

    /// Takes steps. Expects the bits of a new backend that continues from the present state.
    void expect_goes_on(Simulation& simulation, int steps) {
        const Problem problem = simulation.problem();
        made_->upload(problem, simulation.state());
        made_->step(steps);
        simulation.step(steps);
        expect_same_bits(simulation.state(), made_->download());
    }

private:
    std::unique_ptr<Backend> made_;
};

TEST_P(SimulationOn, AHandPullsWhatItHolds) {
    Simulation simulation = start();
    simulation.step(20);
    ASSERT_EQ(simulation.take_hold(top, 1.2, 0.6), "");
    EXPECT_TRUE(simulation.holds());
    EXPECT_EQ(simulation.force(), glm::dvec3(0)) << "before the first step";
    const Problem held = simulation.problem();
    ASSERT_EQ(held.tool.particles.size(), 6u) << "the particle itself, four beside and one below";
    EXPECT_DOUBLE_EQ(held.tool.stiffness, 0.1);
    const State before = simulation.state();
    for (std::size_t n = 0; n < 6; ++n)
        EXPECT_EQ(held.tool.held[n], before.displacement[held.tool.particles[n]]);

    const auto oracle = BackendSpec::parse("cpu_reference").make();
    oracle->upload(held, before);
    for (const glm::dvec3 moved : {glm::dvec3(0, 0, 1), glm::dvec3(0.5, 0, 2)}) {
        simulation.drag(moved);
        oracle->tool()->move_tool(moved);
        simulation.step(15);
        oracle->step(15);
        const glm::dvec3 force = simulation.force(), expected = oracle->tool()->tool_force();
        EXPECT_LT(force.z, -0.01) << "the body pulls back";
        // A few roundings of float32 per step, at displacements below 1.
        EXPECT_LT(glm::distance(force, expected), is_double() ? 1e-12 : 1e-6);
    }
    const State after = simulation.state();
    for (const std::uint32_t i : held.tool.particles)
        EXPECT_GT(after.displacement[i].z, before.displacement[i].z + 0.1);
}

TEST_P(SimulationOn, WhatIsLetGoIsFree) {
    Simulation simulation = start();
    simulation.step(7);
    ASSERT_EQ(simulation.take_hold(top, 1.5, 1), "");
    simulation.drag({0, 0.3, 0.4});
    simulation.step(8);
    simulation.let_go();
    EXPECT_FALSE(simulation.holds());
    EXPECT_FALSE(simulation.problem().has_tool());
    EXPECT_TRUE(simulation.problem().load.empty());
    EXPECT_EQ(simulation.force(), glm::dvec3(0));
    simulation.drag({9, 9, 9});  // no hand holds anything yet
    expect_goes_on(simulation, 11);
    EXPECT_EQ(simulation.steps(), 26);
}

TEST_P(SimulationOn, ABladeCutsWhereTheBodyIs) {
    Scene scene = box();
    // Sheared, and away from where it is at rest.
    scene.state = state_at_rest(scene.problem);
    for (std::size_t i = 0; i < scene.state.displacement.size(); ++i)
        scene.state.displacement[i] = {100 + 0.5 * scene.problem.rest_position[i].z, 0, 0};
    Simulation simulation = start(std::move(scene));
    const std::uint64_t version = simulation.springs_version();
    EXPECT_EQ(simulation.cut(across(3.5)).springs, 0u) << "where the body was at rest";
    EXPECT_EQ(simulation.springs_version(), version);
    const glm::dvec3 along(0.5, 0, 1), from(103.6, -1, 0);
    const Simulation::Change cut =
        simulation.cut({from - 2.0 * along, from + 8.0 * along, from - 2.0 * along + glm::dvec3(0, 9, 0),
                        from + 8.0 * along + glm::dvec3(0, 9, 0)});
    EXPECT_EQ(cut.refused, "");
    EXPECT_GT(simulation.springs_version(), version);
    EXPECT_TRUE(parts_box(simulation.problem(), 3.5));
    Problem expected = simulation.scene().problem;
    EXPECT_EQ(SpringEditor(expected).cut(Plane{{3.5, 0, 0}, {1, 0, 0}}).removed.size(), cut.springs);
    expect_same_springs(simulation.problem(), expected);
    expect_goes_on(simulation, 9);
}

TEST_P(SimulationOn, ANeedleRestoresWhatWasCut) {
    Simulation simulation = start();
    simulation.step(3);
    const std::size_t cut = simulation.cut(across(3.5)).springs;
    simulation.step(3);
    const glm::dvec3 a(3.5, 1, 4), b(3.5, 4, 4);
    const Simulation::Change some = simulation.suture(a, b, 1.2);
    EXPECT_EQ(some.refused, "");
    EXPECT_GT(some.springs, 3u);
    EXPECT_LT(some.springs, cut);
    EXPECT_FALSE(parts_box(simulation.problem(), 3.5));
    const std::uint64_t version = simulation.springs_version();
    const Simulation::Change others = simulation.suture(a, b, 50);
    EXPECT_EQ(some.springs + others.springs, cut);
    EXPECT_GT(simulation.springs_version(), version);
    expect_same_springs(simulation.problem(), simulation.scene().problem);
    expect_goes_on(simulation, 9);
}

TEST_P(SimulationOn, AStitchIsMadeOrRefused) {
    Simulation simulation = start(), twin = start();
    simulation.step(3);
    twin.step(3);
    const glm::dvec3 a(1, 3, 4), b(5, 3, 4);
    EXPECT_EQ(simulation.suture(a, a, 1).springs, 0u) << "a particle with itself";
    EXPECT_EQ(simulation.suture(a, {2, 3, 4}, 0.5).springs, 0u) << "those that are joined";
    const Simulation::Change stitch = simulation.suture(a, b, 0.5);
    EXPECT_EQ(stitch.springs == 0, !stitch.refused.empty());
    if (GetParam().find("cpu_reference") != std::string::npos) {
        EXPECT_EQ(stitch.springs, 1u);
    }
    if (GetParam().find("implicit") != std::string::npos) {
        EXPECT_EQ(stitch.refused,
                  "some springs join particles that are not grid neighbours, which needs neighbour lists");
    }
    if (stitch.springs == 1) {
        ASSERT_EQ(simulation.problem().springs.size(), 1u);
        EXPECT_EQ(simulation.problem().springs[0].rest_length, 4);
        EXPECT_EQ(simulation.suture(a, b, 0.5).springs, 0u) << "it is there";
        expect_goes_on(simulation, 9);
        return;
    }
    EXPECT_EQ(simulation.springs_version(), twin.springs_version());
    simulation.step(9);
    twin.step(9);
    expect_same_bits(simulation.state(), twin.state());
}

TEST_P(SimulationOn, AResetIsAFreshStart) {
    Simulation simulation = start(), fresh = start();
    simulation.step(5);
    simulation.cut(across(2.5));
    const std::uint64_t version = simulation.springs_version();
    ASSERT_EQ(simulation.take_hold(top, 1, 1), "");
    simulation.drag({0, 0, 1});
    simulation.step(5);
    simulation.reset();
    EXPECT_EQ(simulation.steps(), 0);
    EXPECT_FALSE(simulation.holds());
    EXPECT_GT(simulation.springs_version(), version);
    expect_same_springs(simulation.problem(), fresh.problem());
    expect_same_bits(simulation.state(), fresh.state());
    simulation.step(20);
    fresh.step(20);
    expect_same_bits(simulation.state(), fresh.state());
}

TEST_P(SimulationOn, AnotherBackendGoesOn) {
    Simulation simulation = start();
    simulation.step(5);
    simulation.cut(across(2.5));
    ASSERT_EQ(simulation.take_hold(top, 1, 1), "");
    simulation.drag({0, 0, 1});
    simulation.step(5);
    const State before = simulation.state();
    ASSERT_EQ(simulation.switch_to(BackendSpec::parse("cpu_reference")), "");
    EXPECT_EQ(simulation.backend_label(), BackendSpec::parse("cpu_reference").label());
    EXPECT_EQ(simulation.steps(), 10);
    EXPECT_FALSE(simulation.holds());
    EXPECT_FALSE(simulation.problem().has_tool());
    EXPECT_TRUE(parts_box(simulation.problem(), 2.5));
    expect_same_bits(simulation.state(), before);  // float64 of `increment` keeps all bits
    simulation.step(5);
    const State reached = simulation.state();
    ASSERT_EQ(simulation.switch_to(spec()), "");
    EXPECT_EQ(simulation.steps(), 15);
    for (std::size_t i = 0; i < reached.displacement.size(); ++i) {
        // One rounding of float32, at lengths below 1 if a backend keeps displacements.
        const double rounding = is_double() ? 0 : 1e-7;
        EXPECT_LE(glm::distance(simulation.state().displacement[i], reached.displacement[i]), rounding);
    }
    expect_goes_on(simulation, 6);
}

TEST_P(SimulationOn, WhatIsSavedIsWhatARunSaves) {
    Simulation simulation = start();
    simulation.step(12);
    simulation.keep_state();
    const auto file = file_called("simulation.npz");
    simulation.save(file);

    const Scene scene = box();
    const SavedState saved = read_saved_state(file, scene);
    EXPECT_EQ(saved.step, 12);
    expect_same_bits(saved.state, simulation.state());
    SceneRunner runner(scene);
    const auto backend = spec().make();
    runner.rewind(*backend);
    runner.run(*backend, 12);
    const State state = backend->download();
    EXPECT_TRUE(contents_of(file) ==
                npz({scene, scene.problem, state, 12, 12 * scene.problem.time_step, spec().label()}));
    runner.start_from(saved.step, saved.state);
    runner.rewind(*backend);
    runner.run(*backend, 10);
    simulation.step(10);
    expect_same_bits(simulation.state(), backend->download());
}

TEST_P(SimulationOn, ErrorsAreNoneAtFirstAndSmallLater) {
    Simulation simulation = start();
    EXPECT_TRUE(simulation.errors().empty());
    simulation.step(10);
    ASSERT_EQ(simulation.take_hold(top, 1.5, 1), "");
    simulation.drag({0, 0.2, 0});
    simulation.step(2);
    ASSERT_EQ(simulation.compare(true), "");
    EXPECT_TRUE(simulation.compares());
    const std::vector<double> none(simulation.problem().particle_count());
    EXPECT_EQ(simulation.errors(), none);
    const auto expect_small = [&](const char* when) {
        const std::vector<double> errors = simulation.errors();
        const double largest = *std::max_element(errors.begin(), errors.end());
        // A few roundings of float32 per step; the hand's effect is 10^5 times that.
        EXPECT_LT(largest, is_double() ? 1e-12 : 1e-6) << when;
        if (!is_double()) {
            EXPECT_GT(largest, 0) << when;
        }
    };
    simulation.step(10);
    expect_small("in a hold that had begun before");
    simulation.drag({0, 1, 0});
    simulation.step(20);
    expect_small("dragged");
    simulation.cut(across(5.5));
    simulation.step(20);
    expect_small("cut");
    simulation.let_go();
    simulation.step(20);
    expect_small("let go");
    simulation.suture({5.5, 0, 4}, {5.5, 5, 4}, 50);
    ASSERT_EQ(simulation.take_hold({1, 1, 4}, 1, 1), "");
    simulation.drag({0, 0, 0.5});
    simulation.step(20);
    expect_small("sewn and held elsewhere");
    ASSERT_EQ(simulation.switch_to(spec()), "");
    simulation.step(20);
    expect_small("on another backend");
    simulation.reset();
    EXPECT_EQ(simulation.errors(), none);
    simulation.step(20);
    expect_small("after a reset");
    EXPECT_EQ(simulation.compare(false), "");
    EXPECT_TRUE(simulation.errors().empty());
}

INSTANTIATE_TEST_SUITE_P(Backends, SimulationOn,
                         ::testing::Values("cpu_reference", "cpu_parallel", "cpu_parallel:precision=float64",
                                           "gl_compute_implicit", "gl_fragment_implicit",
                                           "gl_compute_explicit"),
                         test_name);

}  // namespace
}  // namespace voxspring::testing
