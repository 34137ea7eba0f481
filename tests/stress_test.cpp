// The stress suite on every backend and formulation of this machine, and how all of them treat degenerate
// input. A backend without its device is skipped, or fails if VOXSPRING_REQUIRE names it (required.h).
#include "harness/study/kinds/stress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <set>

#include "backends/registry.h"
#include "harness/scene/scene.h"
#include "harness/study/kinds/stability.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/verify.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

class Stress : public BackendTest {
protected:
    bool has_gates() const { return by_increments(spec.options.formulation); }
};

/// The rows of a suite; checks that names of measurements are unique.
class Collected {
public:
    Once once() {
        return [this](const std::string& name, const std::function<Rows()>& measure) {
            EXPECT_TRUE(names_.insert(name).second) << name;
            for (auto& [list, rows] : measure()) {
                for (const auto& row : rows) rows_[list].push_back(row);
            }
        };
    }
    const Rows& rows() const { return rows_; }

private:
    std::set<std::string> names_;
    Rows rows_;
};

INSTANTIATE_TEST_SUITE_P(, Stress, ::testing::ValuesIn(in_every_formulation()), test_name);

TEST_P(Stress, EveryGateHolds) {
    static StressReferences references;
    Collected collected;
    run_stress(spec, *backend, StressLengths::shortest, references, collected.once());
    const Rows& lists = collected.rows();
    EXPECT_FALSE(lists.contains("skipped")) << nlohmann::json(lists.at("skipped")).dump(1);
    EXPECT_FALSE(lists.contains("failed")) << nlohmann::json(lists.at("failed")).dump(1);
    std::set<int> parts;
    for (const auto& row : lists.at("stress")) {
        parts.insert(row.at("part").get<int>());
        EXPECT_FALSE(row.at("measured").is_null()) << row;
        // A formulation that is made for it has a gate on rounding.
        EXPECT_TRUE(row.at("part") != 9 || row.at("gate").is_number() == has_gates()) << row;
    }
    for (const int part : {1, 2, 3, 4, 5, 6, 7, 9}) EXPECT_TRUE(parts.contains(part)) << part;
    EXPECT_EQ(parts.contains(8), spec.entry->tuning.contains("terms"));
}

// Under a sanitizer it takes twenty times as long.
#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(undefined_behavior_sanitizer)
#define VOXSPRING_SANITIZED
#endif
#endif

// The gates of the box where they were measured: 32^3, 1e3 and 1e4 steps, at least three times the
// measurement.
TEST(StressAtFullLength, TheBox) {
#ifdef VOXSPRING_SANITIZED
    GTEST_SKIP() << "minutes under a sanitizer";
#endif
    const Scene scene = load_scene("box");
    const auto reference = BackendSpec::parse("cpu_parallel:precision=float64,formulation=increment").make();
    for (const auto& [formulation, gates] : {std::pair{"increment", std::array{1.5e-6, 1.2e-5}},
                                             std::pair{"compensated", std::array{1.5e-7, 8e-6}}}) {
        const auto backend =
            BackendSpec::parse(std::string("cpu_parallel:formulation=") + formulation).make();
        backend->upload(scene.problem, scene.state);
        reference->upload(scene.problem, scene.state);
        int steps = 0;
        for (const auto& [until, gate] : {std::pair{1000, gates[0]}, std::pair{10000, gates[1]}}) {
            backend->step(until - steps);
            reference->step(until - steps);
            steps = until;
            const Comparison off =
                compare(scene.problem, backend->download(), reference->download(), Precision::float32, steps);
            EXPECT_LE(off.relative_l2, gate) << formulation << " after " << steps;
        }
    }
}

/// A cpu_parallel that gets a slightly wrong problem.
class Distorted : public Backend {
public:
    explicit Distorted(double time_scale)
        : time_scale_(time_scale), sound_(BackendSpec::parse("cpu_parallel:formulation=increment").make()) {}
    Capabilities capabilities() const override { return sound_->capabilities(); }
    void upload(const Problem& problem, const State& state) override {
        problem_ = problem;
        problem_.time_step *= time_scale_;
        sound_->upload(problem_, state);
    }
    void edit(const Problem&, const SpringEdit&) override {}
    void step(int count) override { sound_->step(count); }
    void synchronize() override {}
    State download() override { return sound_->download(); }

private:
    void mark(Mark) override {}
    double seconds_between_marks() const override { return 0; }

    double time_scale_;
    std::unique_ptr<Backend> sound_;
    Problem problem_;
};

TEST(StressSuite, FindsATimeStepThatIsOffByATenThousandth) {
    StressReferences references;
    Collected collected;
    Distorted backend(1 + 1e-4);
    run_stress(BackendSpec::parse("cpu_parallel:formulation=increment"), backend, StressLengths::shortest,
               references, collected.once());
    const Rows& lists = collected.rows();
    std::set<std::string> failed;
    for (const auto& row : lists.at("stress")) {
        if (!row.at("passed").get<bool>()) failed.insert(row.at("measurement"));
    }
    EXPECT_TRUE(failed.contains("box"));
    EXPECT_TRUE(failed.contains("small time step"));
    EXPECT_FALSE(failed.contains("rest"));
    EXPECT_EQ(lists.at("failed").size(),
              std::size_t(std::count_if(lists.at("stress").begin(), lists.at("stress").end(),
                                        [](const auto& row) { return !row.at("passed"); })));
}

/// The rows of a study of cpu_parallel, whose times of the limit are those of theory, and of one whose time
/// step is 1% longer than it was told. The latter diverges 1% earlier.
std::pair<Rows, Rows> stability_of(const Scene& scene, bool map) {
    const BackendSpec spec = BackendSpec::parse("cpu_parallel:formulation=increment");
    const std::vector<double> limits = stability_limits(scene);
    Collected honest, distorted;
    run_stability(spec, *spec.make(), scene, limits, map, honest.once());
    EXPECT_FALSE(honest.rows().contains("failed")) << honest.rows().at("failed").at(0);
    EXPECT_EQ(honest.rows().at("stability").size(), 7u);
    // Measured: 1.0000 to 1.0010.
    for (const auto& row : honest.rows().at("stability"))
        EXPECT_TRUE(row.at("tolerance").is_null() || std::abs(row.at("ratio").get<double>() - 1) < 2e-3)
            << row;
    Distorted backend(1.01);
    run_stability(spec, backend, scene, limits, false, distorted.once());
    EXPECT_FALSE(distorted.rows().contains("stability_map"));
    EXPECT_EQ(distorted.rows().at("failed").size(), 4u) << "all that theory holds for";
    return {honest.rows(), distorted.rows()};
}

TEST(Stability, MeasuresWhatTheoryGives) {
    const auto [lists, distorted] = stability_of(load_scene("box@4"), true);
    for (const auto& row : lists.at("stability"))
        EXPECT_TRUE(row.at("start").at("amplitude") != 0.3 || row.at("ratio") < 0.95) << row;
    const auto& map = lists.at("stability_map").at(0);
    const auto& region = map.at("region");
    ASSERT_EQ(region.size(), map.at("damping").size());
    ASSERT_EQ(region[0].size(), map.at("fraction").size());
    EXPECT_EQ(region[0].back(), "diverged") << "undamped and above the limit";
    EXPECT_EQ(region[5][0], "bounded") << "damped and far below it";

    EXPECT_NEAR(distorted.at("stability")[0].at("ratio").get<double>(), 1 / 1.01, 2e-3);
}

// A stretched body of several materials is in equilibrium only under loads.
TEST(Stability, MeasuresWhatTheoryGivesOfSeveralMaterials) {
    Problem problem = make_lattice_problem(
        make_grid({6, 6, 6}, [](int x, int y, int z) { return 1 + (x / 3 + y / 3 + z / 3) % 2; }),
        FACE_BITS | EDGE_BITS);
    problem.materials = {{1, 1}, {1, 1000}};
    (void)stability_of(scene_of("soft_and_stiff", problem), false);
}

/// Runs a backend, in any precision, on a problem that is degenerate at rest or at its start.
struct Degenerate {
    std::string name;
    Problem problem;
    State start;
};

Problem pinned_cube() {
    Problem problem = make_lattice_problem(solid({4, 4, 4}), FACE_BITS | EDGE_BITS);
    problem.time_step = 0.25;
    problem.damping = 0.05;
    pin_base(problem);
    return problem;
}

std::vector<Degenerate> degenerate_inputs() {
    std::vector<Degenerate> all;
    const Problem cube = pinned_cube();
    const auto add = [&](const std::string& name, const Problem& problem, const auto& change) {
        State start = state_at_rest(problem);
        change(start);
        all.push_back({name, problem, start});
    };
    constexpr std::size_t middle = (2 * 4 + 1) * 4 + 1;
    add("coincident", cube, [&](State& s) { s.displacement[middle].x = 1; });
    add("swapped", cube, [&](State& s) {
        s.displacement[middle].x = 1;
        s.displacement[middle + 1].x = -1;
    });
    add("inverted_top_layer", cube, [&](State& s) {
        for (std::size_t i = 48; i < 64; ++i) s.displacement[i].z = -2;
    });
    Problem loose = make_lattice_problem(
        make_grid({5, 5, 5}, [](int x, int y, int z) { return x % 2 == 0 && y % 2 == 0 && z % 2 == 0; }),
        FACE_BITS | EDGE_BITS);
    loose.time_step = 0.25;
    loose.gravity = {0, 0, -0.01};
    add("isolated_particles", loose, [](State&) {});
    Problem ratio = make_lattice_problem(make_grid({4, 4, 4}, [](int, int, int z) { return z < 2 ? 1 : 2; }),
                                         FACE_BITS | EDGE_BITS);
    ratio.materials = {{1, 1e-6}, {1, 1}};
    ratio.time_step = 0.25;
    ratio.damping = 0.05;
    pin_base(ratio);
    add("stiffness_ratio", ratio, [&](State& s) { s.displacement[middle + 16].x = 0.1; });
    Problem pulled = cube;
    pulled.rest_length.fill(0);
    pulled.damping = 0.2;
    add("zero_rest_length", pulled, [](State&) {});
    return all;
}

TEST_P(Stress, DegenerateInputIsTheSameEverywhere) {
    // After 60 steps: rounding of float32 and the order of sums, amplified by up to 100 where springs meet.
    const double tolerance = spec.options.precision == Precision::float32 ? 2e-4 : 1e-10;
    const auto oracle = BackendSpec::parse("cpu_reference").make();
    for (const Degenerate& input : degenerate_inputs()) {
        SCOPED_TRACE(input.name);
        if (const std::string why = backend->unsupported(input.problem); !why.empty()) {
            // Kinds of lists without a stiffness per spring, and the march, whose forces are in units of rest
            // lengths, refuse this.
            EXPECT_TRUE(input.problem.has_materials() || input.name == "zero_rest_length") << why;
            continue;
        }
        const State expected = run_from(input.start, input.problem, *oracle, 60);
        const State state = run_from(input.start, input.problem, *backend, 60);
        double worst = 0;
        for (std::size_t i = 0; i < state.displacement.size(); ++i) {
            const double off = glm::length(state.displacement[i] - expected.displacement[i]);
            ASSERT_TRUE(std::isfinite(off)) << "particle " << i;
            worst = std::max(worst, off);
        }
        EXPECT_LE(worst, tolerance);
        RecordProperty(input.name, std::to_string(worst));
    }
}

// The claims of harness/scenes/README.md about these, on the oracle.
TEST(ExtremeCases, AreAsDocumented) {
    const auto after = [](const std::string& name, int steps) {
        for (const Degenerate& input : degenerate_inputs()) {
            if (input.name != name) continue;
            const auto oracle = BackendSpec::parse("cpu_reference").make();
            return std::pair{input, run_from(input.start, input.problem, *oracle, steps)};
        }
        throw std::runtime_error("no " + name);
    };
    for (const char* name : {"coincident", "swapped"})
        EXPECT_LT(differences(after(name, 5000).second, {}).max, 1e-12);
    // The mirror image of a layer, with the layer next to it as the mirror, has springs of rest length. So a
    // layer that lies there stays there.
    const auto [inverted, state] = after("inverted_top_layer", 5000);
    EXPECT_LT(glm::length(state.displacement[55] - inverted.start.displacement[55]), 1e-9);
    // A particle without springs falls freely.
    const State fallen = after("isolated_particles", 100).second;
    for (const glm::dvec3& u : fallen.displacement)
        EXPECT_NEAR(u.z, -0.01 * 0.25 * 0.25 * 100 * 101 / 2, 1e-12);
    // Springs of rest length zero pull all particles onto the pinned ones.
    const State pulled = after("zero_rest_length", 5000).second;
    for (std::size_t i = 48; i < 64; ++i) EXPECT_NEAR(pulled.displacement[i].z, -3, 1e-6);
}

}  // namespace
}  // namespace voxspring::testing
