// What is written of a run beside its state: velocities at the time of the state, the force on a tool, and
// the list of a series.
#include "harness/export/export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/export/export_formats.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/conserved.h"
#include "tests/support.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::ElementsAre;

/// A run of a scene on cpu_reference.
class Played {
public:
    explicit Played(const Scene& scene) : scene_(scene), runner_(scene) { runner_.rewind(*backend_); }

    const State& after(int steps) {
        runner_.run(*backend_, steps - step_);
        step_ = steps;
        return state_ = backend_->download();
    }
    std::vector<glm::dvec3> velocity() const {
        return velocities({scene_, runner_.problem(), state_, step_, step_ * scene_.problem.time_step, ""});
    }

private:
    const Scene& scene_;
    SceneRunner runner_;
    std::unique_ptr<Backend> backend_ = BackendSpec::parse("cpu_reference").make();
    State state_;
    int step_ = 0;
};

TEST(ExportedVelocity, OfASpringIsThatOfItsClosedForm) {
    Problem problem = make_lattice_problem(solid({2, 1, 1}), FACE_BITS);
    pin(problem, {1, 0});
    const double stiffness = 0.7, mass = 1.3, time_step = 0.4, amplitude = 0.1;
    problem.materials = {{.mass = mass}};
    problem.group_stiffness = {stiffness, 1, 1};
    problem.time_step = time_step;
    State start = state_at_rest(problem);
    start.displacement[1].x = amplitude;  // the same displacement at x(-dt)
    const Scene scene = scene_of("spring", problem, start);
    Played played(scene);
    // x(n dt) = A cos((n + 1/2) theta) / cos(theta / 2) solves x(t + dt) - 2 x(t) + x(t - dt) = -w^2 dt^2
    // x(t).
    const double theta = 2 * std::asin(std::sqrt(stiffness / mass) * time_step / 2);
    for (const int n : {0, 1, 2, 7, 40}) {
        const double place = amplitude * std::cos((n + 0.5) * theta) / std::cos(theta / 2);
        const double velocity =
            -amplitude * std::sin((n + 0.5) * theta) * std::sin(theta) / std::cos(theta / 2) / time_step;
        // Roundings of lengths near 1, added up over the steps.
        EXPECT_NEAR(played.after(n).displacement[1].x, place, 1e-13) << n;
        EXPECT_NEAR(played.velocity()[1].x, velocity, 1e-13) << n;
        EXPECT_EQ(played.velocity()[0], glm::dvec3(0)) << "pinned";
    }
}

TEST(ExportedVelocity, IsTheCentralDifferenceWhateverActs) {
    Problem problem = make_lattice_problem(random_grid({6, 5, 7}, 0.8, 3, 2), FACE_BITS | EDGE_BITS);
    problem.materials = {{.mass = 1, .stiffness = 1}, {.mass = 2.5, .stiffness = 3}};
    pin_base(problem);
    problem.gravity = {1e-3, 0, -2e-3};
    problem.damping = 0.03;
    problem.load.assign(problem.particle_count(), glm::dvec3(0, 5e-4, 0));
    const auto count = std::uint32_t(problem.particle_count());
    take_hold(problem, {.particles = {count - 3, count - 1}, .held = {}, .stiffness = 0.2});
    Scene scene = scene_of("busy", problem, random_state(problem, 0.05, 5));
    scene.tool_motion = {3, {0, 2, 9}, {{0, 0, 0}, {0, 0.5, 0.3}, {0.4, 0, 0}}};
    Problem edited = scene.problem;
    scene.edits = {{4, SpringEditor(edited).cut(Plane{{2.5, 0, 0}, {1, 0, 0}})}};
    Played played(scene), ahead(scene);
    // The tool moves after steps 0, 3, 6, ...; springs are cut after step 4, at which there is a snapshot.
    for (const int step : {1, 2, 3, 5, 6, 9}) {
        const State now = played.after(step), next = ahead.after(step + 1);
        const std::vector<glm::dvec3> velocity = played.velocity();
        double fastest = 0;
        for (std::size_t i = 0; i < velocity.size(); ++i) {
            const glm::dvec3 expected =
                (now.increment[i] + next.increment[i]) / (2 * scene.problem.time_step);
            // Two orders of a sum in float64.
            EXPECT_LT(glm::distance(velocity[i], expected), 1e-13) << step << ", particle " << i;
            fastest = std::max(fastest, glm::length(expected));
        }
        EXPECT_GT(fastest, 1e-3);
    }
}

TEST(ExportedVelocity, GivesAnEnergyThatHardlyWanders) {
    Problem problem = make_lattice_problem(solid({5, 5, 5}), FACE_BITS | EDGE_BITS);
    pin_base(problem);
    problem.gravity = {0, 0, -1e-3};
    const Scene scene = scene_of("undamped", problem);
    Played played(scene);
    std::vector<double> centred, half_a_step_old;
    for (int step = 5; step <= 400; step += 5) {
        State state = played.after(step);
        half_a_step_old.push_back(energy(scene.problem, state).total());
        const std::vector<glm::dvec3> velocity = played.velocity();
        for (std::size_t i = 0; i < velocity.size(); ++i)
            state.increment[i] = velocity[i] * scene.problem.time_step;
        centred.push_back(energy(scene.problem, state).total());
    }
    const auto wander = [](const std::vector<double>& values) {
        const auto [low, high] = std::minmax_element(values.begin(), values.end());
        return *high - *low;
    };
    // Its error is of second order in the time step, not of first.
    EXPECT_LT(wander(centred), wander(half_a_step_old) / 5);
}

std::vector<std::string> listed_in(const std::filesystem::path& collection) {
    std::vector<std::string> names;
    std::ifstream list(collection);
    for (std::string line; std::getline(list, line);) {
        const std::size_t at = line.find("file=\"");
        if (at != std::string::npos) names.push_back(line.substr(at + 6, line.rfind('"') - at - 6));
    }
    return names;
}

/// A series of a body at rest, one file after each second step.
class ExportedSeries : public ::testing::Test {
protected:
    ExportedSeries() {
        options_.out = {folder_.path() / "body.vtu"};
        options_.every = 2;
    }
    void write(Exports& exports, const std::vector<int>& steps) const {
        for (const int step : steps) exports.write({scene_, scene_.problem, state_, step, step * 0.5, ""});
    }
    std::vector<std::string> listed() const { return listed_in(folder_.path() / "body.pvd"); }

    const TemporaryFolder folder_;
    const Scene scene_ = scene_of("box", make_lattice_problem(solid({2, 2, 2}), FACE_BITS));
    const State state_ = state_at_rest(scene_.problem);
    ExportOptions options_;
};

TEST_F(ExportedSeries, HasAFileAfterEachMultipleWhereverItBegins) {
    options_.every = 10;
    const Exports exports(options_, 15);
    EXPECT_EQ(exports.next(0), 10);
    EXPECT_EQ(exports.next(9), 10) << "fewer steps are left than lie between two files";
    EXPECT_EQ(exports.next(10), 15);
    EXPECT_EQ(Exports(options_, 20).next(10), 20);
    constexpr int most = std::numeric_limits<int>::max();
    EXPECT_EQ(Exports(options_, most).next(most - 1), most);
}

TEST_F(ExportedSeries, IsNotOverwrittenByTheForcesOfATool) {
    options_.every = 10;
    options_.out = {folder_.path() / "a.csv"};
    for (const auto& [name, refused] : {std::pair{"a_000010.csv", true},
                                        {"a_000015.csv", true},
                                        {"a.csv", false},
                                        {"a_000005.csv", false},
                                        {"a_10.csv", false},
                                        {"b_000010.csv", false}}) {
        options_.tool_force = folder_.path() / name;
        if (refused) {
            EXPECT_THROW(Exports(options_, 15), BadInput) << name;
        } else {
            EXPECT_NO_THROW(Exports(options_, 15)) << name;
        }
    }
}

TEST_F(ExportedSeries, ListsAFileOnceIfTheRunIsInterruptedRightAfterIt) {
    Exports exports(options_, 10);
    write(exports, {2, 4});
    exports.end_at(4);
    write(exports, {4});
    EXPECT_THAT(listed(), ElementsAre("body_000002.vtu", "body_000004.vtu"));
}

TEST_F(ExportedSeries, OfAResumedRunListsTheFilesBeforeItToo) {
    Exports first(options_, 10), second(options_, 1'000'000), anew(options_, 10);
    write(first, {2, 4, 6});
    second.resume_from(5);
    write(second, {6, 8});
    EXPECT_THAT(listed(),
                ElementsAre("body_000002.vtu", "body_000004.vtu", "body_0000006.vtu", "body_0000008.vtu"))
        << "with more digits, since the second run is longer";
    write(anew, {2});
    EXPECT_THAT(listed(), ElementsAre("body_000002.vtu")) << "a run from the start";
}

}  // namespace
}  // namespace voxspring::testing
