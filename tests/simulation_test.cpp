// A body in a user's hands: what holding, cutting, sewing and switching do to it, on several backends; what a
// simulation refuses, how it follows its scene's edits and motions, and how it outlives its backends.
#include "harness/simulation/simulation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <iterator>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "harness/export/export_formats.h"
#include "harness/export/saved_state.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"
#include "harness/scene/stability.h"
#include "harness/simulation/picking.h"
#include "tests/required.h"
#include "tests/support.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

const glm::ivec3 dims(8, 6, 5);
const glm::dvec3 top(4, 3, 4);  // a particle in the uppermost slice

/// A box on its base, which gravity shears.
Scene box() {
    Problem problem = make_lattice_problem(solid(dims), FACE_BITS | EDGE_BITS);
    pin_base(problem);
    problem.damping = 0.01;
    problem.gravity = {8e-4, 0, -2e-3};
    return scene_of("box", std::move(problem));
}

/// The quad in the plane x = `at` across the whole box.
std::array<glm::dvec3, 4> across(double at) { return {{{at, -2, -2}, {at, -2, 9}, {at, 9, -2}, {at, 9, 9}}}; }

bool parts_box(const Problem& problem, double at) {
    const auto springs = list_springs(problem);
    return std::none_of(springs.begin(), springs.end(), [&](const Spring& spring) {
        return (problem.rest_position[spring.first].x < at) != (problem.rest_position[spring.second].x < at);
    });
}

std::string contents_of(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

std::filesystem::path file_called(const std::string& name) {
    return std::filesystem::path(::testing::TempDir()) / name;
}

class SimulationOn : public BackendTest {
protected:
    Simulation start(Scene scene = box()) const { return {std::move(scene), spec}; }
    bool is_double() const { return spec.options.precision == Precision::float64; }

    /// Takes steps. Expects the bits of a new backend that continues from the present state.
    void expect_goes_on(Simulation& simulation, int steps) {
        const Problem problem = simulation.problem();
        backend->upload(problem, simulation.state());
        backend->step(steps);
        simulation.step(steps);
        expect_same_bits(simulation.state(), backend->download());
    }
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
        EXPECT_EQ(stitch.refused, "some springs are not those of the lattice, which needs neighbour lists");
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
    int replaced = 0;
    const Backend* const replaced_backend = &simulation.backend();
    ASSERT_EQ(simulation.switch_to(BackendSpec::parse("cpu_reference"),
                                   [&] {
                                       ++replaced;
                                       EXPECT_EQ(&simulation.backend(), replaced_backend);
                                   }),
              "");
    EXPECT_EQ(replaced, 1);
    EXPECT_EQ(simulation.backend_label(), BackendSpec::parse("cpu_reference").label());
    EXPECT_EQ(simulation.steps(), 10);
    EXPECT_FALSE(simulation.holds());
    EXPECT_FALSE(simulation.problem().has_tool());
    EXPECT_TRUE(parts_box(simulation.problem(), 2.5));
    expect_same_bits(simulation.state(), before);  // float64 of `increment` keeps all bits
    simulation.step(5);
    const State reached = simulation.state();
    ASSERT_EQ(simulation.switch_to(spec), "");
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
    runner.rewind(*backend);
    runner.run(*backend, 12);
    const State state = backend->download();
    EXPECT_TRUE(contents_of(file) ==
                npz({scene, scene.problem, state, 12, 12 * scene.problem.time_step, spec.label()}));
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
    ASSERT_EQ(simulation.switch_to(spec), "");
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

// --- Backends that do not do as they are told ------------------------------------------------------------

/// The next fault of backends with that name, or of those that exist.
struct Faults {
    bool in_step = false, in_upload = false, in_download = false;
    bool refuses = false, absent = false;
    bool has_tool = true;
};
Faults faults;

/// cpu_reference with faults.
class Wayward final : public WrappedBackend, public ToolFacet {
public:
    Wayward() {
        if (faults.absent) throw Unavailable("it is not here");
    }
    std::string unsupported(const Problem& problem) const override {
        return faults.refuses ? "it does not want to" : Backend::unsupported(problem);
    }
    ToolFacet* tool() override { return faults.has_tool ? this : nullptr; }
    void move_tool(const glm::dvec3& moved) override { inner().tool()->move_tool(moved); }
    glm::dvec3 tool_force() override { return inner().tool()->tool_force(); }
    void upload(const Problem& problem, const State& state) override {
        fail_if(faults.in_upload);
        uploaded_ = &problem;
        mask_ = problem.lattice.mask;
        WrappedBackend::upload(problem, state);
    }
    void step(int count) override {
        fail_if(faults.in_step);
        EXPECT_EQ(uploaded_->lattice.mask, mask_) << "what was uploaded has changed";
        WrappedBackend::step(count);
    }
    State download() override {
        fail_if(faults.in_download);
        return WrappedBackend::download();
    }

private:
    void fail_if(bool fault) {
        // A backend that has failed may only be destroyed.
        if (has_failed_) ADD_FAILURE() << "asked after it had failed";
        if (!fault) return;
        has_failed_ = true;
        throw DeviceError("the device is lost");
    }

    bool has_failed_ = false;
    const Problem* uploaded_ = nullptr;
    std::vector<std::uint32_t> mask_;
};

const Registered wayward = registered_as<Wayward>("wayward");

class SimulationOfOne : public ::testing::Test {
protected:
    void SetUp() override { faults = {}; }
    static BackendSpec reference() { return BackendSpec::parse("cpu_reference"); }
    static BackendSpec bad() { return BackendSpec::parse("wayward"); }

    /// Expects both to be in the same place, and to stay so.
    static void expect_alike(Simulation& simulation, Simulation& twin) {
        expect_same_bits(simulation.state(), twin.state());
        expect_same_springs(simulation.problem(), twin.problem());
        EXPECT_EQ(simulation.steps(), twin.steps());
        EXPECT_EQ(simulation.holds(), twin.holds());
        simulation.step(5);
        twin.step(5);
        expect_same_bits(simulation.state(), twin.state());
    }
};

TEST_F(SimulationOfOne, ABackendThatRefusesStartsNothing) {
    faults.refuses = true;
    EXPECT_THROW(Simulation(box(), bad()), std::runtime_error);
    faults = {.absent = true};
    EXPECT_THROW(Simulation(box(), bad()), Unavailable);
    faults = {};
    auto made = bad().make();
    const Backend* const which = made.get();
    Simulation simulation(box(), bad(), std::move(made));
    EXPECT_EQ(&simulation.backend(), which);
}

TEST_F(SimulationOfOne, WhatIsRefusedChangesNothing) {
    Simulation simulation(box(), bad()), twin(box(), reference());
    simulation.step(4);
    twin.step(4);
    faults.has_tool = false;
    EXPECT_EQ(simulation.take_hold(top, 2, 1), "the backend does not support a tool that holds particles");
    EXPECT_FALSE(simulation.problem().has_tool());
    expect_alike(simulation, twin);
    faults = {.refuses = true};
    const Simulation::Change cut = simulation.cut(across(3.5));
    EXPECT_EQ(cut.springs, 0u);
    EXPECT_EQ(cut.refused, "it does not want to");
    expect_alike(simulation, twin);
    // An array on the card that belongs to the present backend stays, because that backend does.
    int replaced = 0;
    const auto count = [&] { ++replaced; };
    EXPECT_EQ(twin.switch_to(bad(), count), "it does not want to");
    EXPECT_EQ(replaced, 0);
    faults = {.absent = true};
    EXPECT_EQ(twin.switch_to(bad()), "it is not here");
    faults = {.in_upload = true};
    EXPECT_EQ(twin.switch_to(bad()), "the device is lost");
    EXPECT_EQ(twin.backend_label(), reference().label());
    faults = {};
    expect_alike(simulation, twin);
}

// Catches a hand that pushes away what it holds, and one that makes the body's positions NaN.
TEST_F(SimulationOfOne, AHandHasAPositiveStiffnessAndRadius) {
    Simulation simulation(box(), reference()), twin(box(), reference());
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (const auto& [radius, stiffness] :
         {std::pair(1.0, -0.5), {1.0, 0.0}, {1.0, nan}, {-1.0, 1.0}, {nan, 1.0}}) {
        EXPECT_NE(simulation.take_hold(top, radius, stiffness).find("a hand needs"), std::string::npos);
        EXPECT_FALSE(simulation.holds());
    }
    expect_alike(simulation, twin);
}

TEST_F(SimulationOfOne, AHoldOutlivesARefusedSwitch) {
    Simulation simulation(box(), reference());
    ASSERT_EQ(simulation.take_hold(top, 1, 1), "");
    simulation.drag({0, 0, 1});
    simulation.step(5);
    const glm::dvec3 force = simulation.force();
    faults.refuses = true;
    EXPECT_NE(simulation.switch_to(bad()), "");
    EXPECT_TRUE(simulation.holds());
    EXPECT_EQ(simulation.force(), force);
    EXPECT_TRUE(simulation.problem().has_tool());
}

TEST_F(SimulationOfOne, AnotherHoldTakesThePlaceOfTheFirst) {
    Simulation simulation(box(), reference());
    ASSERT_EQ(simulation.take_hold(top, 1, 1), "");
    simulation.drag({0, 0, 1});
    simulation.step(5);
    ASSERT_EQ(simulation.take_hold({0, 0, 4}, 0.1, 1), "");
    EXPECT_EQ(simulation.problem().tool.particles, std::vector<std::uint32_t>{8 * 6 * 4});
    simulation.step(1);
    EXPECT_LT(glm::length(simulation.force()), 1e-9) << "it has not moved since";
    ASSERT_EQ(simulation.compare(true), "");
    simulation.step(5);
    for (const double error : simulation.errors()) EXPECT_LT(error, 1e-13) << "nor has its companion's";
}

// --- The time step ---------------------------------------------------------------------------------------

TEST_F(SimulationOfOne, NoHandIsStifferThanTheTimeStepBears) {
    Scene scene = box();
    scene.problem.time_step = 0.9 * scene.stable_time_step;
    Simulation simulation(scene, reference());
    ASSERT_EQ(simulation.take_hold(top, 2, 1e9), "");
    EXPECT_GT(stable_time_step(simulation.problem()), scene.problem.time_step);
    simulation.drag({0, 0, 0.5});
    simulation.step(2000);
    EXPECT_TRUE(finite(simulation.state()));
    EXPECT_LT(glm::length(simulation.state().displacement.back()), 1);
    simulation.let_go();
    ASSERT_EQ(simulation.take_hold(top, 2, 1e-3), "");
    EXPECT_DOUBLE_EQ(simulation.problem().tool.stiffness * double(simulation.problem().tool.particles.size()),
                     1e-3)
        << "a soft one is as soft as it was asked to be";
}

TEST_F(SimulationOfOne, ATimeStepThatIsNotStableBearsNothingMore) {
    Scene scene = box();
    scene.problem.time_step = 1.01 * scene.stable_time_step;
    Simulation simulation(scene, reference()), twin(scene, reference());
    EXPECT_NE(simulation.take_hold(top, 2, 1), "");
    EXPECT_NE(simulation.suture({1, 3, 4}, {5, 3, 4}, 0.5).refused, "");
    expect_alike(simulation, twin);
}

TEST_F(SimulationOfOne, StitchesStopBeforeTheTimeStepIsTooLong) {
    Scene scene = box();
    scene.problem.time_step = 0.9 * scene.stable_time_step;
    Simulation simulation(scene, reference());
    ASSERT_EQ(simulation.take_hold(top, 2, 1e9), "");
    Simulation::Change stitch;
    glm::dvec3 refused(0);
    std::size_t stitches = 0;
    for (int y = 0; y < dims.y && stitch.refused.empty(); ++y) {
        for (int x = 0; x < dims.x && stitch.refused.empty(); ++x) {
            if (x == 4 && y == 3) continue;
            refused = {x, y, 0};
            stitch = simulation.suture(top, refused, 0.1);
            stitches += stitch.springs;
            EXPECT_GT(stable_time_step(simulation.problem()), scene.problem.time_step);
        }
    }
    EXPECT_GT(stitches, 0u) << "at the surface there is room";
    EXPECT_NE(stitch.refused, "");
    EXPECT_EQ(simulation.problem().springs.size(), stitches);
    // A reset removes everything that was made before it.
    simulation.reset();
    EXPECT_EQ(simulation.suture(top, refused, 0.1).springs, 1u);
    // A cut may be sewn again any number of times.
    for (int n = 0; n < 5; ++n) {
        ASSERT_EQ(simulation.cut({{{-2, -2, 2.5}, {20, -2, 2.5}, {-2, 20, 2.5}, {20, 20, 2.5}}}).refused, "");
        EXPECT_TRUE(simulation.problem().springs.empty());
        ASSERT_EQ(simulation.suture(top, top, 50).refused, "");
        ASSERT_EQ(simulation.suture(top, {0, 0, 0}, 0.1).springs, 1u);
    }
}

// --- Edits and motions of the scene's own -----------------------------------------------------------------

/// A box that its scene cuts twice and sews once, and that a tool moves.
Scene busy_box() {
    Scene scene = box();
    Tool tool;
    for (std::uint32_t i = 8 * 6 * 4; i < 8 * 6 * 4 + 8; ++i) tool.particles.push_back(i);
    tool.stiffness = 0.25;
    take_hold(scene.problem, tool);
    scene.tool_motion = {4, {0, 4, 9}, {{0, 0, 0}, {0, 0.2, 0.3}, {0.3, 0, 0}}};
    Problem problem = scene.problem;
    SpringEditor editor(problem);
    scene.edits.push_back({3, editor.cut(Plane{{2.5, 0, 0}, {1, 0, 0}})});
    scene.edits.push_back({3, editor.cut(Plane{{5.5, 0, 0}, {1, 0, 0}})});
    scene.edits.push_back({10, editor.suture(Plane{{2.5, 0, 0}, {1, 0, 0}}, 1.5)});
    scene.stable_time_step = stable_time_step(scene.problem);
    scene.problem.time_step = scene.stable_time_step / 2;
    return scene;
}

TEST_F(SimulationOfOne, AScenesOwnEditsAndMotionsAreThoseOfAStudy) {
    const Scene scene = busy_box();
    Simulation simulation(scene, reference());
    const auto backend = reference().make();
    SceneRunner runner(scene);
    runner.rewind(*backend);
    for (const int steps : {1, 2, 1, 5, 0, 6, 13}) {
        simulation.step(steps);
        runner.run(*backend, steps);
        expect_same_bits(simulation.state(), backend->download());
        expect_same_springs(simulation.problem(), runner.problem());
    }
    // Compared half way through, its companion has the tool where it is.
    Simulation compared(scene, reference());
    compared.step(6);
    ASSERT_EQ(compared.compare(true), "");
    compared.step(22);
    expect_same_bits(compared.state(), backend->download());
    for (const double error : compared.errors()) EXPECT_LT(error, 1e-13) << "sums in another order";
    // Switched half way through, it goes on as if nothing had been.
    Simulation switched(scene, reference());
    switched.step(6);
    ASSERT_EQ(switched.switch_to(reference()), "");
    switched.step(22);
    expect_same_bits(switched.state(), backend->download());
}

TEST_F(SimulationOfOne, TheHandTakesTheToolFromTheScene) {
    Simulation simulation(busy_box(), reference());
    simulation.step(5);
    ASSERT_EQ(simulation.take_hold({7, 5, 4}, 0.1, 1), "");
    EXPECT_EQ(simulation.problem().tool.particles.size(), 1u);
    const Problem held = simulation.problem();
    const auto backend = reference().make();
    backend->upload(held, simulation.state());
    backend->tool()->move_tool({0, 0, 0.1});
    backend->step(4);
    simulation.drag({0, 0, 0.1});
    simulation.step(4);
    expect_same_bits(simulation.state(), backend->download());
    simulation.let_go();
    EXPECT_FALSE(simulation.problem().has_tool());
    EXPECT_TRUE(simulation.problem().load.empty()) << "they were zero";
    simulation.step(10);
    simulation.reset();
    Simulation fresh(busy_box(), reference());
    simulation.step(12);
    fresh.step(12);
    expect_alike(simulation, fresh);

    Scene loaded = busy_box();
    loaded.problem.load[3] = {0, 0, 1e-3};
    Simulation with_loads(loaded, reference());
    ASSERT_EQ(with_loads.take_hold(top, 1, 1), "");
    with_loads.let_go();
    EXPECT_EQ(with_loads.problem().load, loaded.problem.load) << "they are the scene's own";
    loaded = box();
    loaded.problem.load.resize(loaded.problem.particle_count());
    Simulation with_none(loaded, reference());
    ASSERT_EQ(with_none.take_hold(top, 1, 1), "");
    with_none.let_go();
    EXPECT_EQ(with_none.problem().load, loaded.problem.load) << "and so are zeros without a tool";
}

TEST_F(SimulationOfOne, WhatStillAppliesOfAnEditIsMade) {
    const Scene scene = busy_box();
    // The backend keeps what an edit says about its particles.
    const BackendSpec spec = BackendSpec::parse("cpu_parallel:precision=float64");
    Simulation simulation(scene, spec);
    // Half of what the scene is about to cut, and other springs of the same particles.
    ASSERT_GT(simulation.cut({{{2.5, -2, 2.5}, {2.5, -2, 9}, {2.5, 9, 2.5}, {2.5, 9, 9}}}).springs, 10u);
    ASSERT_GT(simulation.cut(across(3.5)).springs, 10u);
    simulation.step(5);
    Problem expected = scene.problem;
    SpringEditor editor(expected);
    editor.cut(Plane{{2.5, 0, 0}, {1, 0, 0}});
    editor.cut(Plane{{5.5, 0, 0}, {1, 0, 0}});
    editor.cut(Plane{{3.5, 0, 0}, {1, 0, 0}});
    expect_same_springs(simulation.problem(), expected);
    // The needle sews what the scene has cut, before the scene does.
    ASSERT_GT(simulation.suture({2.5, 0, 4}, {2.5, 5, 4}, 1.2).springs, 10u);
    simulation.step(10);
    editor.suture(Plane{{2.5, 0, 0}, {1, 0, 0}}, 1.5);
    expect_same_springs(simulation.problem(), expected);
    const auto backend = spec.make();
    const Problem problem = simulation.problem();
    backend->upload(problem, simulation.state());
    backend->tool()->move_tool(scene.tool_motion.at(12 * scene.problem.time_step));
    backend->step(1);
    simulation.step(1);
    expect_same_bits(simulation.state(), backend->download());
}

TEST_F(SimulationOfOne, ARunGoesOnFromWhatTheHandHasCutAndSewn) {
    const Scene scene = busy_box();
    const BackendSpec spec = BackendSpec::parse("cpu_reference");
    Simulation simulation(scene, spec);
    simulation.step(2);
    ASSERT_GT(simulation.cut({{{2.5, -2, 2.5}, {2.5, -2, 9}, {2.5, 9, 2.5}, {2.5, 9, 9}}}).springs, 10u);
    ASSERT_GT(simulation.suture({0, 0, 4}, {7, 5, 4}, 0.1).springs, 0u);
    // Before the scene has cut, and after.
    for (const int steps : {1, 4}) {
        simulation.step(steps);
        simulation.keep_state();
        const auto file = file_called("of_a_hand.npz");
        simulation.save(file);

        Scene goes_on = scene;
        const SavedState saved = read_saved_state(file, goes_on);
        EXPECT_EQ(saved.mask, simulation.problem().lattice.mask);
        EXPECT_EQ(saved.springs, simulation.problem().springs);
        EXPECT_GT(springs_that_differ(goes_on, saved), 0u);
        take_springs(goes_on, saved);
        SceneRunner runner(goes_on);
        runner.start_from(saved.step, saved.state);
        const auto backend = spec.make();
        runner.rewind(*backend);
        runner.run(*backend, 20);
        Simulation until_then(scene, spec);
        until_then.step(2);
        until_then.cut({{{2.5, -2, 2.5}, {2.5, -2, 9}, {2.5, 9, 2.5}, {2.5, 9, 9}}});
        until_then.suture({0, 0, 4}, {7, 5, 4}, 0.1);
        until_then.step(saved.step - 2 + 20);
        expect_same_springs(runner.problem(), until_then.problem());
        expect_same_bits(backend->download(), until_then.state());
    }
}

TEST_F(SimulationOfOne, ABackendTakesTheEditsToComeOrNothing) {
    Scene scene = box();
    Problem problem = scene.problem;
    const std::vector<std::pair<std::uint32_t, std::uint32_t>> far = {{0, 239}};
    scene.edits.push_back({5, SpringEditor(problem).suture(far)});
    const BackendSpec implicit = BackendSpec::parse("cpu_parallel");
    EXPECT_THROW(Simulation(scene, implicit), std::runtime_error);
    Simulation simulation(scene, reference());
    const std::string why = simulation.switch_to(implicit);
    EXPECT_NE(why.find("(edit after step 5)"), std::string::npos) << why;
    simulation.step(6);
    EXPECT_EQ(simulation.problem().springs.size(), 1u);
    simulation.cut({{{-2, -2, 2.5}, {20, -2, 2.5}, {-2, 20, 2.5}, {20, 20, 2.5}}});
    EXPECT_EQ(simulation.switch_to(implicit), "") << "it was made, and is cut";
}

// --- Failures --------------------------------------------------------------------------------------------

TEST_F(SimulationOfOne, WhatWasKeptOutlivesTheDevice) {
    Simulation simulation(busy_box(), bad()), twin(busy_box(), reference());
    for (Simulation* both : {&simulation, &twin}) {
        both->step(5);
        both->cut(across(0.5));
        both->keep_state();
    }
    simulation.step(6);  // makes an edit, of which no state is kept
    faults.in_step = true;
    EXPECT_THROW(simulation.step(1), DeviceError);
    faults = {};
    EXPECT_THROW(simulation.step(1), DeviceError);
    EXPECT_THROW(simulation.state(), DeviceError);
    EXPECT_THROW(simulation.take_hold(top, 1, 1), DeviceError);
    EXPECT_THROW(simulation.cut(across(3.5)), DeviceError);
    EXPECT_THROW(simulation.reset(), DeviceError);

    const auto file = file_called("kept.npz");
    simulation.save(file);
    const Scene scene = busy_box();
    EXPECT_TRUE(contents_of(file) ==
                npz({scene, twin.problem(), twin.state(), 5, 5 * scene.problem.time_step, bad().label()}));

    faults.absent = true;
    EXPECT_EQ(simulation.switch_to(bad()), "it is not here");
    EXPECT_THROW(simulation.step(1), DeviceError) << "it is as lost as before";
    const std::uint64_t version = simulation.springs_version();
    ASSERT_EQ(simulation.switch_to(reference()), "");
    EXPECT_GT(simulation.springs_version(), version) << "the edit is undone";
    expect_alike(simulation, twin);
    expect_alike(simulation, twin);  // the edit was made again
}

TEST_F(SimulationOfOne, AFailureThatShowsWhenItIsLeftIsOne) {
    Simulation simulation(box(), bad()), twin(box(), reference());
    ASSERT_EQ(simulation.compare(true), "");
    for (Simulation* both : {&simulation, &twin}) {
        both->step(5);
        both->keep_state();
    }
    simulation.step(3);
    faults.in_download = true;
    ASSERT_EQ(simulation.switch_to(reference()), "");
    for (const double error : simulation.errors()) EXPECT_EQ(error, 0) << "it goes on from there as well";
    expect_alike(simulation, twin);
}

TEST_F(SimulationOfOne, NothingKeptIsTheStart) {
    Simulation simulation(box(), bad());
    faults.in_step = true;
    EXPECT_THROW(simulation.step(1), DeviceError);
    const auto file = file_called("start.npz");
    simulation.save(file);
    const SavedState saved = read_saved_state(file, simulation.scene());
    EXPECT_EQ(saved.step, 0);
    expect_same_bits(saved.state, state_at_rest(simulation.scene().problem));
    EXPECT_THROW(simulation.save(file_called("no folder/start.npz")), std::system_error);
}

TEST_F(SimulationOfOne, ABodyThatHasLeftAllBoundsIsOnlyResetOrSaved) {
    Scene scene = box();
    scene.state = state_at_rest(scene.problem);
    scene.state.displacement.back() = {0.1, 0, 0};
    scene.stable_time_step *= 100;  // as if such a time step were stable
    scene.problem.time_step = scene.stable_time_step / 10;
    Simulation simulation(scene, reference()), twin(scene, reference());
    simulation.step(1);
    const State kept = simulation.state();
    simulation.step(2000);
    EXPECT_FALSE(finite(simulation.state()));
    const std::uint64_t version = simulation.springs_version();
    const std::string why = "the state is no longer finite";
    EXPECT_EQ(simulation.take_hold(top, 1, 1), why);
    EXPECT_EQ(simulation.cut(across(3.5)).refused, why);
    EXPECT_EQ(simulation.suture(top, {0, 0, 0}, 1).refused, why);
    EXPECT_EQ(simulation.compare(true), why);
    EXPECT_EQ(simulation.switch_to(reference()), why);
    EXPECT_EQ(simulation.springs_version(), version);
    const auto file = file_called("bounds.npz");
    simulation.save(file);
    const SavedState saved = read_saved_state(file, scene);
    EXPECT_EQ(saved.step, 1);
    expect_same_bits(saved.state, kept);
    simulation.reset();
    expect_same_bits(simulation.state(), twin.state());
}

TEST_F(SimulationOfOne, ALargeBodyIsNotCompared) {
    const glm::ivec3 large(64, 64, 62);
    ASSERT_GT(std::size_t(large.x) * std::size_t(large.y) * std::size_t(large.z), Simulation::max_compared);
    Simulation simulation(scene_of("large", make_lattice_problem(solid(large), FACE_BITS)),
                          BackendSpec::parse("cpu_parallel"));
    EXPECT_NE(simulation.compare(true), "");
    EXPECT_FALSE(simulation.compares());
}

}  // namespace
}  // namespace voxspring::testing
