// The error gate: honest backends pass it, and models that are wrong in one respect fail it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/error_threshold.h"
#include "harness/verification/errors.h"
#include "tests/required.h"
#include "tests/specifications.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

// --- Scenes ----------------------------------------------------------------------------------------------

Scene pinned_at_its_end(const std::string& name, glm::ivec3 dims) {
    Problem problem = make_lattice_problem(solid(dims), FACE_BITS);
    std::vector<std::uint8_t> pinned(problem.particle_count());
    pinned[0] = 1;
    pin(problem, std::move(pinned));
    problem.gravity = {2e-3, 0, 5e-4};
    return scene_of(name, problem);
}

Scene scene_named(const std::string& name) {
    if (name == "rope") return pinned_at_its_end(name, {1, 1, 40});
    if (name == "pendulum") return pinned_at_its_end(name, {1, 1, 2});
    if (name != "random_37%") return load_scene(name);
    // Particles that hang on one or two springs form mechanisms, which amplify rounding.
    Problem problem = make_lattice_problem(random_grid({31, 33, 29}, 0.37, 37), FACE_BITS | EDGE_BITS);
    pin_base(problem);
    problem.gravity = {8e-4, 0, -2e-3};
    return scene_of(name, problem);
}

// --- Wrong models ----------------------------------------------------------------------------------------

void lose_diagonal(Problem& problem) {
    const std::uint32_t bits = 0x3u << 6;  // (-1, -1, 0) and (1, 1, 0)
    for (std::uint32_t& mask : problem.lattice.mask) mask &= ~bits;
}

struct Wrong {
    std::string name;
    std::function<bool(const Scene&)> applies;
    std::function<void(Scene&)> change;
};
bool has_edges(const Scene& scene) { return (scene.problem.group_bits & EDGE_BITS) != 0; }

const std::vector<Wrong>& wrong_models() {
    static const std::vector<Wrong> all = {
        {"a diagonal missing", has_edges, [](Scene& scene) { lose_diagonal(scene.problem); }},
        {"edge stiffness -10%", has_edges, [](Scene& scene) { scene.problem.group_stiffness[1] *= 0.9; }},
        {"rest length +1%", [](const Scene&) { return true; },
         [](Scene& scene) {
             for (double& length : scene.problem.rest_length) length *= 1.01;
         }},
        {"gravity +1%", [](const Scene&) { return true; },
         [](Scene& scene) { scene.problem.gravity *= 1.01; }},
        {"damping ignored", [](const Scene& scene) { return scene.problem.damping > 0; },
         [](Scene& scene) { scene.problem.damping = 0; }},
        {"edits ignored", [](const Scene& scene) { return !scene.edits.empty(); },
         [](Scene& scene) { scene.edits.clear(); }},
    };
    return all;
}

// --- Judging ---------------------------------------------------------------------------------------------

References& references() {
    static References shared;  // $VOXSPRING_CACHE
    return shared;
}

State play(const Scene& scene, const BackendSpec& spec, int steps) {
    const auto backend = spec.make();
    SceneRunner runner(scene);
    runner.rewind(*backend);
    runner.run(*backend, steps);
    return backend->download();
}

/// A scene after some steps, and the reference and spread that runs of it are compared with.
struct Judged {
    Judged(const std::string& name, int count) : scene(scene_named(name)), steps(count) {
        last = problem_after(scene, steps);
        same_step = references().after(scene, steps);
    }
    ReferenceSolution solution(const BackendSpec& spec) const {
        ReferenceSolution solution{last, steps, same_step, {}, scene.state};
        const RoundingModel model = rounding_model_of(spec);
        solution.spreads.emplace_back(model, references().spread(scene, steps, same_step, model));
        return solution;
    }
    State start() const { return scene.state.in_full(scene.problem.particle_count()); }
    Scene scene;
    int steps;
    Problem last;
    State same_step;
};

/// The error over its bound: the larger of the two ratios, or that of the statistics.
double load(const Comparison& comparison) {
    return std::max(comparison.max / comparison.tolerance, comparison.rms / comparison.tolerance_rms);
}

struct GateCase {
    std::string scene;
    int steps;
    std::vector<Formulation> formulations;
    /// Rounding has grown until wrong models differ as much: only a model that takes no step is recognised.
    bool tells_little = false;
    bool chaotic = false;
    friend std::ostream& operator<<(std::ostream& out, const GateCase& c) {
        return out << c.scene << " " << c.steps;
    }
};

std::vector<GateCase> gate_cases() {
    const std::vector<Formulation> two = {Formulation::position, Formulation::increment};
    const std::vector<Formulation>& all = every_formulation;
    std::vector<GateCase> cases = {{"box@32", 1000, two},
                                   {"heart", 1000, two},
                                   {"scalpel_100", 1000, two},
                                   {"random_37%", 200, all},
                                   {"random_37%", 1000, all, true},
                                   {"rope", 1000, all},
                                   {"rope", 10000, all, true, true},
                                   {"pendulum", 1000, all},
                                   {"pendulum", 10000, all}};
    // It takes as long as all others together, and is for the table of docs/accuracy.md.
    if (std::getenv("VOXSPRING_GATES") != nullptr) cases.push_back({"box@32", 10000, two});
    return cases;
}

/// Writes rows for the table of docs/accuracy.md, which docs/figures.py makes, to the file that
/// VOXSPRING_GATES names; does nothing if it names none.
void record(const nlohmann::json& row) {
    static nlohmann::json rows = nlohmann::json::array();
    const char* path = std::getenv("VOXSPRING_GATES");
    if (path == nullptr) return;
    rows.push_back(row);
    std::ofstream(path) << rows.dump(1) << "\n";
}

class Gate : public ::testing::TestWithParam<GateCase> {};
INSTANTIATE_TEST_SUITE_P(, Gate, ::testing::ValuesIn(gate_cases()), [](const auto& tested) {
    std::string name = tested.param.scene + "_" + std::to_string(tested.param.steps);
    for (char& c : name) {
        if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
    }
    return name;
});

TEST_P(Gate, PassesTheHonestWithRoomAndNoneThatIsWrong) {
    const Judged judged(GetParam().scene, GetParam().steps);
    for (const Formulation formulation : GetParam().formulations) {
        const BackendSpec spec = BackendSpec::parse("cpu_parallel:formulation=" + to_string(formulation));
        SCOPED_TRACE(spec.label());
        const ReferenceSolution solution = judged.solution(spec);
        const Spread& spread = solution.spreads.front().second;
        const Comparison honest = judge(solution, play(judged.scene, spec, judged.steps), spec);
        EXPECT_TRUE(honest.passed()) << honest.reason;
        EXPECT_EQ(is_chaotic(spread), GetParam().chaotic);
        if (GetParam().tells_little) {
            EXPECT_FALSE(judge(solution, judged.start(), spec).passed()) << "nothing done";
            continue;
        }
        // Four spreads are the gate; an honest error is about one.
        EXPECT_LT(load(honest), 0.7);
        nlohmann::json row = {{"scene", GetParam().scene},
                              {"steps", judged.steps},
                              {"formulation", to_string(formulation)},
                              {"precision", to_string(spec.options.precision)},
                              {"spread_share", spread.rms / spread.motion_rms},
                              {"gate_share", honest.tolerance_rms / spread.motion_rms},
                              {"honest_in_spreads", honest.rms / spread.rms}};
        const auto expect_caught = [&](const std::string& name, const State& state) {
            const Comparison wrong = judge(solution, state, spec);
            EXPECT_FALSE(wrong.passed()) << name << ": " << load(wrong) << " of the gate";
            row["wrong_in_gates"][name] = load(wrong);
        };
        expect_caught("nothing done", judged.start());
        for (const Wrong& wrong : wrong_models()) {
            if (!wrong.applies(judged.scene)) continue;
            Scene changed = judged.scene;
            wrong.change(changed);
            expect_caught(wrong.name, play(changed, spec, judged.steps));
        }
        record(row);
    }
}

// In so few steps the body moves by less than the threshold of 1e-3 in each.
TEST(Sleep, PassesWhereItCostsLittleAndNotWhereTheBodyNeverMoves) {
    for (const char* scene : {"box@16", "heart@20x17x15"}) {
        SCOPED_TRACE(scene);
        const Judged judged(scene, 5);
        for (const char* threshold : {"1e-3", "1e-6"}) {
            const BackendSpec spec = BackendSpec::parse(std::string("cpu_parallel:sleep=") + threshold);
            EXPECT_FALSE(judge(judged.solution(spec), judged.start(), spec).passed()) << threshold;
        }
        const BackendSpec fine = BackendSpec::parse("cpu_parallel:sleep=1e-6");
        const Comparison slept = judge(judged.solution(fine), play(judged.scene, fine, 5), fine);
        EXPECT_TRUE(slept.passed()) << slept.reason;
    }
}

// --- Every backend ---------------------------------------------------------------------------------------

std::vector<std::string> default_specifications() {
    std::vector<std::string> all;
    for (const auto& [name, entry] : registry()) {
        all.push_back(name);
        if (name != "cpu_reference") all.push_back(name + ":formulation=position");
    }
    return all;
}

class EveryBackend : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override { make_or_skip(spec, backend); }
    const BackendSpec spec = BackendSpec::parse(GetParam());
    std::unique_ptr<Backend> backend;
};
INSTANTIATE_TEST_SUITE_P(, EveryBackend, ::testing::ValuesIn(default_specifications()), test_name);

TEST_P(EveryBackend, PassesOnBodiesWithMechanisms) {
    for (const char* name : {"random_37%", "rope", "pendulum"}) {
        const Judged judged(name, 1000);
        if (!backend->unsupported(judged.scene.problem).empty()) continue;
        const Comparison comparison =
            judge(judged.solution(spec), play(judged.scene, spec, judged.steps), spec);
        EXPECT_TRUE(comparison.passed()) << name << ": " << comparison.reason;
    }
}

// --- The bound itself ------------------------------------------------------------------------------------

TEST(TheBound, IsFourSpreadsAndNoMoreThanATenthOfTheMotion) {
    EXPECT_EQ(gate(1e-3, 1, 0), 4e-3);
    EXPECT_EQ(gate(1e-3, 1, 0.05), 4e-3 + 0.05);
    EXPECT_EQ(gate(1e-3, 1, 0.5), 0.1) << "whatever the options admit";
    EXPECT_EQ(gate(1e-3, 0, 0.5), 4e-3 + 0.5) << "where nothing moves";
    EXPECT_EQ(gate(0.04, 1, 0), 0.1);
    EXPECT_EQ(gate(0.05, 1, 0), 0.1);
    EXPECT_TRUE(std::isinf(gate(0.051, 1, 0))) << "it would be nearer than two spreads";
    EXPECT_EQ(gate(1e-3, 0, 0), 4e-3) << "where nothing moves";
    EXPECT_EQ(gate(0, 1, 0), 0);
    EXPECT_TRUE(std::isinf(gate(INFINITY, 1, 0)));
    EXPECT_TRUE(std::isinf(gate(NAN, 1, 0)));
}

TEST(TheBound, OfAStatisticIsAShareOfItsSize) {
    EXPECT_EQ(statistic_gate(0, 2), 0.5);
    EXPECT_EQ(statistic_gate(0.25, 2), 1);
    EXPECT_EQ(statistic_gate(0.75, 2), 1.5);
    EXPECT_TRUE(std::isinf(statistic_gate(0.76, 2)));
}

}  // namespace
}  // namespace voxspring::testing
