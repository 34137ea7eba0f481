// The error gate: honest backends pass it, and models that are wrong in one respect fail it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/selection.h"
#include "harness/study/study.h"
#include "harness/verification/error_threshold.h"
#include "harness/verification/errors.h"
#include "harness/verification/random_starts.h"
#include "tests/required.h"
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

// --- Wrong programs --------------------------------------------------------------------------------------

State play(const Scene& scene, const BackendSpec& spec, int steps) {
    const auto backend = spec.make();
    SceneRunner runner(scene);
    runner.rewind(*backend);
    runner.run(*backend, steps);
    return backend->download();
}

/// A wrong program: its state after some steps of a scene, and the scenes in which its fault shows.
struct Mutant {
    std::string name;
    std::function<State(const Scene&, const BackendSpec&, int steps)> play;
    std::function<bool(const Scene&)> applies = [](const Scene&) { return true; };
};

bool has_edges(const Scene& scene) { return (scene.problem.group_bits & EDGE_BITS) != 0; }
bool is_damped(const Scene& scene) { return scene.problem.damping > 0; }
bool is_edited(const Scene& scene) { return !scene.edits.empty(); }
/// If there are two layers, the lower one is pinned, and never leaves the place of the start.
bool has_border(const Scene& scene) { return scene.problem.rest_position.back().z >= 2; }

/// A program that plays another scene.
auto changed(const std::function<void(Scene&)>& change) {
    return [change](const Scene& scene, const BackendSpec& spec, int steps) {
        Scene wrong = scene;
        change(wrong);
        return play(wrong, spec, steps);
    };
}

auto without_directions(std::uint32_t bits) {
    return changed([bits](Scene& scene) {
        for (std::uint32_t& mask : scene.problem.lattice.mask) mask &= ~bits;
    });
}
auto without_diagonal() { return without_directions(0x3u << 6); }  // (-1, -1, 0) and (1, 1, 0)
auto with_gravity(double factor) {
    return changed([factor](Scene& scene) { scene.problem.gravity *= factor; });
}
auto without_edits() {
    return changed([](Scene& scene) { scene.edits.clear(); });
}

/// Each thousandth particle stays where it is.
State play_without_some(const Scene& scene, const BackendSpec& spec, int steps) {
    State state = play(scene, spec, steps);
    for (std::size_t i = state.displacement.size() - 1; i < state.displacement.size(); i -= 1000)
        state.displacement[i] = scene.state.displacement_of(i);
    return state;
}

/// Two parts, one above the other, each of which sees the other where it was at the start.
State play_without_exchange(const Scene& scene, const BackendSpec& spec, int steps) {
    const std::vector<glm::dvec3>& rest = scene.problem.rest_position;
    const double middle = rest[rest.size() / 2].z;
    State whole = scene.state.in_full(rest.size());
    for (const bool above : {false, true}) {
        Scene part = scene;
        std::vector<std::uint8_t> pinned(rest.size());
        for (std::size_t i = 0; i < rest.size(); ++i)
            pinned[i] = scene.problem.is_pinned(i) || (rest[i].z > middle) != above ? 1 : 0;
        pin(part.problem, std::move(pinned));
        const State state = play(part, spec, steps);
        for (std::size_t i = 0; i < rest.size(); ++i) {
            if ((rest[i].z > middle) == above) whole.displacement[i] = state.displacement[i];
        }
    }
    return whole;
}

/// What the gate of a long run catches.
const std::vector<Mutant>& mutants_of_gates() {
    static const std::vector<Mutant> all = {
        {"a diagonal missing", without_diagonal(), has_edges},
        {"edge stiffness -10%", changed([](Scene& scene) { scene.problem.group_stiffness[1] *= 0.9; }),
         has_edges},
        {"rest length +1%", changed([](Scene& scene) {
             for (double& length : scene.problem.rest_length) length *= 1.01;
         })},
        {"gravity +1%", with_gravity(1.01)},
        {"damping ignored", changed([](Scene& scene) { scene.problem.damping = 0; }), is_damped},
        {"edits ignored", without_edits(), is_edited}};
    return all;
}

/// What the run that verifies a timed scene catches.
const std::vector<Mutant>& mutants_of_timed_scenes() {
    static const std::vector<Mutant> all = {{"no spring", changed([](Scene& scene) {
                                                 scene.problem.group_stiffness = {0, 0, 0};
                                             })},
                                            {"a face direction missing", without_directions(0x3u)},
                                            {"a diagonal missing", without_diagonal()},
                                            {"stiffness -5%", changed([](Scene& scene) {
                                                 for (double& k : scene.problem.group_stiffness) k *= 0.95;
                                             })},
                                            {"gravity +5%", with_gravity(1.05)},
                                            {"one particle of a thousand wrong", play_without_some},
                                            {"a border not exchanged", play_without_exchange, has_border},
                                            {"edits ignored", without_edits(), is_edited}};
    return all;
}

// --- Judging ---------------------------------------------------------------------------------------------

References& references() {
    static References shared;  // $VOXSPRING_CACHE
    return shared;
}

/// A scene after some steps, and the reference and spread that runs of it are compared with.
struct Judged {
    Judged(const std::string& name, int count) : Judged(scene_named(name), count) {}
    Judged(Scene judged, int count) : scene(std::move(judged)), steps(count) {
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
    return name_of_test(tested.param.scene + "_" + std::to_string(tested.param.steps));
});

TEST_P(Gate, PassesTheHonestWithRoomAndNoneThatIsWrong) {
    const Judged judged(GetParam().scene, GetParam().steps);
    for (const Formulation formulation : GetParam().formulations) {
        const BackendSpec spec = BackendSpec::parse("cpu_parallel:formulation=" + to_string(formulation));
        SCOPED_TRACE(spec.label());
        const ReferenceSolution solution = judged.solution(spec);
        const Spread& spread = solution.spreads.front().second;
        const JudgedState honest = judge(solution, play(judged.scene, spec, judged.steps), spec);
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
            const JudgedState wrong = judge(solution, state, spec);
            EXPECT_FALSE(wrong.passed()) << name << ": " << load(wrong) << " of the gate";
            row["wrong_in_gates"][name] = load(wrong);
        };
        expect_caught("nothing done", judged.start());
        for (const Mutant& mutant : mutants_of_gates()) {
            if (mutant.applies(judged.scene))
                expect_caught(mutant.name, mutant.play(judged.scene, spec, judged.steps));
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
        const JudgedState slept = judge(judged.solution(fine), play(judged.scene, fine, 5), fine);
        EXPECT_TRUE(slept.passed()) << slept.reason;
    }
}

// --- Every scene that is timed ---------------------------------------------------------------------------

/// A scene of a study in a size that takes no time: of a box a column of the
/// whole height, of a heart a smaller one. Both lie in the far corner of the body, where coordinates and thus
/// their rounding are the same as there. The number of steps stays, and so does the share of a box that its
/// pins reach.
Scene small_twin(const std::string& name) {
    const std::size_t at = name.find('@');
    const std::string body = name.substr(0, at), size = at == std::string::npos ? "" : name.substr(at + 1);
    glm::ivec3 dims(60, 51, 46);  // of the heart
    if (std::sscanf(size.c_str(), "%dx%dx%d", &dims.x, &dims.y, &dims.z) == 1) dims = glm::ivec3(dims.x);
    if (dims.x * dims.y * dims.z <= 32 * 32 * 32 || size.empty()) return load_scene(name);
    glm::ivec3 small(10, 10, dims.z);
    if (body == "heart") small = {20, 17, 15};
    if (body == "incision") small = {24, 48, 48};  // as far as the blade comes
    Scene scene = load_scene(fmt::format("{}@{}x{}x{}", body, small.x, small.y, small.z));
    for (glm::dvec3& position : scene.problem.rest_position) position += glm::dvec3(dims - small);
    return scene;
}

/// The rounding models of the cases of a study's scene.
struct TimedScene {
    std::string scene;
    int steps = 0;
    bool strained = false;  ///< StudyScene::is_strained()
    std::set<std::pair<Formulation, Precision>> models = {};
    friend std::ostream& operator<<(std::ostream& out, const TimedScene& timed) {
        return out << timed.scene << " " << timed.steps;
    }
};

std::vector<TimedScene> timed_scenes() {
    std::map<std::pair<std::string, int>, TimedScene> all;
    for (const char* name : {"fastest", "figure8", "edits", "overhead"}) {
        const Study study = load_study(name);
        for (const StudyScene& item : study.scenes) {
            TimedScene& timed = all[{item.scene, item.steps}];
            timed = {item.scene, item.steps, item.is_strained(), timed.models};
            for (const BackendSpec& spec : known_specs(study, item))
                timed.models.emplace(spec.options.formulation, spec.options.precision);
        }
    }
    std::vector<TimedScene> list;
    for (const auto& [key, timed] : all) list.push_back(timed);
    return list;
}

class EveryTimedScene : public ::testing::TestWithParam<TimedScene> {};
INSTANTIATE_TEST_SUITE_P(, EveryTimedScene, ::testing::ValuesIn(timed_scenes()), [](const auto& tested) {
    return name_of_test(tested.param.scene + "_" + std::to_string(tested.param.steps));
});

// Judges as a study does: by the scene's own start, and by a strained one if that strains too few springs.
TEST_P(EveryTimedScene, IsVerifiedByARunThatNoMutantPasses) {
    Scene scene = small_twin(GetParam().scene);
    if (GetParam().strained) scene.state = strained_start(scene.problem);
    const int steps = GetParam().steps;
    std::vector<Judged> starts;
    starts.reserve(2);  // solutions refer to them
    starts.emplace_back(scene, steps);
    // The threshold of formulations by increments is a hundred times as tight. Where runs take seconds, that
    // of position tells more.
    const bool is_long = double(steps) * double(scene.problem.particle_count()) > 1e7;
    for (const auto& [formulation, precision] : GetParam().models) {
        if (is_long && by_increments(formulation) && GetParam().models.size() > 1) continue;
        const BackendSpec spec = BackendSpec::parse("cpu_parallel:formulation=" + to_string(formulation) +
                                                    ",precision=" + to_string(precision));
        SCOPED_TRACE(spec.label());
        std::vector<ReferenceSolution> solutions = {starts.front().solution(spec)};
        if (strained_share(solutions.front(), spec) < min_strained_share) {
            if (starts.size() == 1) {
                Scene strained = scene;
                strained.state = strained_start(scene.problem);
                starts.emplace_back(std::move(strained), steps);
            }
            solutions.push_back(starts.back().solution(spec));
            // In longer runs the share of a column or a small heart is not that of the body.
            if (steps <= 40) {
                EXPECT_GE(strained_share(solutions.back(), spec), min_strained_share);
            }
        }
        const auto passes = [&](const auto& play_one) {
            for (std::size_t n = solutions.size(); n-- > 0;) {
                const JudgedState found = judge(solutions[n], play_one(starts[n].scene, spec, steps), spec);
                if (!found.passed()) return false;
            }
            return true;
        };
        EXPECT_TRUE(passes(play));
        for (const Mutant& mutant : mutants_of_timed_scenes()) {
            if (mutant.applies(scene)) {
                EXPECT_FALSE(passes(mutant.play)) << mutant.name;
            }
        }
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

class EveryBackend : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(, EveryBackend, ::testing::ValuesIn(default_specifications()), test_name);

TEST_P(EveryBackend, PassesOnBodiesWithMechanisms) {
    for (const char* name : {"random_37%", "rope", "pendulum"}) {
        const Judged judged(name, 1000);
        if (!backend->unsupported(judged.scene.problem).empty()) continue;
        const JudgedState comparison =
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
