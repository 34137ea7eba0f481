// Every backend that this machine can run, in every precision and tuning that it registers, against
// cpu_reference on small problems of every kind. A backend without its device is skipped, or fails if
// VOXSPRING_REQUIRE names it (required.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/layout/march_cost.h"
#include "backends/registry.h"
#include "harness/study/selection.h"
#include "harness/study/study.h"
#include "harness/verification/verify.h"
#include "tests/bodies.h"
#include "tests/required.h"
#include "tests/simd_target.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

const std::map<std::string, Problem>& cases() {
    static const auto all = [] {
        std::map<std::string, Problem> problems = small_bodies();
        problems["one_particle_in_a_grid"] =
            lattice(make_grid({5, 4, 3}, [](int x, int y, int z) { return x == 2 && y == 1 && z == 1; }));
        problems["wide_box"] = lattice(solid({67, 3, 5}));
        problems["all_three_groups"] = lattice(random_grid({11, 9, 10}, 0.7, 3), NEIGHBOUR_BITS);
        problems["stiffness_per_group"] = problems["all_three_groups"];
        problems["stiffness_per_group"].group_stiffness = {1.0, 0.5, 0.25};
        problems["anisotropic_spacing"] = lattice(solid({9, 10, 11}, {0.7, 1.0, 1.9}), NEIGHBOUR_BITS);
        problems["several_labels"] = lattice(random_grid({12, 11, 10}, 0.7, 4, 3));
        problems["several_labels"].materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
        problems["pinned"] = pinned(lattice(random_grid({12, 11, 10}, 0.7, 5)));
        Problem& loads = problems["loads"] = lattice(solid({7, 6, 5}));
        loads.load.assign(loads.particle_count(), glm::dvec3(0));
        loads.load[3] = {0.01, -0.02, 0.03};
        loads.load.back() = {0, 0, -0.05};
        problems["corner_of_a_grid"] =
            lattice(make_grid({70, 21, 9}, [](int x, int y, int z) { return x > 40 && y > 14 && z > 5; }));
        problems["network_without_a_grid"] = with_dynamics(random_network(300, 1000, 6));
        problems["sutured_lattice"] = sutured(lattice(random_grid({9, 8, 7}, 0.9, 6)));
        problems["no_damping_no_gravity"] = lattice(solid({7, 6, 5}));
        problems["no_damping_no_gravity"].damping = 0;
        problems["no_damping_no_gravity"].gravity = glm::dvec3(0);
        return problems;
    }();
    return all;
}

/// Whether the backend of `spec` may refuse `problem`; every other refusal is a failure.
bool may_refuse(const BackendSpec& spec, const Problem& problem) {
    const std::string& backend = spec.entry->name;
    const bool counts_groups = backend == "cuda_explicit_cached_grid";
    // Tiles keep no list of the springs beyond the lattice.
    const bool has_lists = spec.entry->addressing == Addressing::by_lists && backend != "cuda_tiles";
    if (!problem.springs.empty()) return counts_groups || !has_lists;
    if (backend == "cuda_resident") return problem.has_materials();
    if (backend == "cuda_bricks" || backend == "cuda_tiles")
        return problem.has_materials() || !problem.load.empty() || (problem.group_bits & CORNER_BITS) != 0;
    if (backend == "cuda_march") {
        // Tiles that fit one precision are too large for the other.
        const std::string& tile = spec.options.tuning.at("tile");
        if (tile != "auto" && layout::march_tile(tile, spec.options.precision).shape.warps() == 0)
            return true;
        return problem.has_materials() || !problem.load.empty() || (problem.group_bits & CORNER_BITS) != 0;
    }
    const glm::dvec3 spacing = problem.lattice.spacing;
    const bool cubic = spacing.x == spacing.y && spacing.y == spacing.z;
    return counts_groups && (problem.has_materials() || !cubic);
}

TEST(Roster, HasWhatIsRequired) {
    for (const std::string& prefix : required_prefixes()) {
        const bool found = std::any_of(registry().begin(), registry().end(),
                                       [&](const auto& entry) { return entry.first.starts_with(prefix); });
        EXPECT_TRUE(found) << prefix << " is required and not in this build";
    }
}

/// A parameter is a specification, followed by "@" and the name of a SIMD target if it is to run on that one.
class Conformance : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override {
        if (const std::size_t at = GetParam().find('@'); at != std::string::npos)
            target.emplace(simd_target(GetParam().substr(at + 1)));
        make_or_skip(spec, backend);
    }
    Comparison compared(const Problem& problem, const State& state, const State& expected, int steps) const {
        return compare(problem, state, expected, spec.options.precision, steps, spec.options.formulation,
                       spec.root_error());
    }
    /// Expects the backend to be where the reference is after `steps` steps.
    Comparison expect_agreement(const Problem& problem, Backend& oracle, int steps) const {
        Comparison comparison = compared(problem, backend->download(), oracle.download(), steps);
        EXPECT_TRUE(comparison.passed()) << "after " << steps << " steps: " << comparison.reason;
        return comparison;
    }
    /// Calls visit(problem, edits, edited) for every case of edits that the backend runs.
    template <class Visit>
    void for_each_edited(Visit visit) const;

    std::optional<ChosenTarget> target;
    const BackendSpec spec = BackendSpec::parse(GetParam().substr(0, GetParam().find('@')));
    std::unique_ptr<Backend> backend;
};

TEST_P(Conformance, AgreesWithTheReference) {
    for (const auto& [name, problem] : cases()) {
        SCOPED_TRACE(name);
        if (const std::string why = backend->unsupported(problem); !why.empty()) {
            EXPECT_TRUE(may_refuse(spec, problem)) << "unsupported: " << why;
            continue;
        }
        const State start = random_state(problem, 0.05, 7);
        const auto oracle = BackendSpec::parse("cpu_reference").make();
        oracle->upload(problem, start);
        backend->upload(problem, start);
        int steps = 0;
        for (const int batch : {1, 2, 17}) {
            oracle->step(batch);
            backend->step(batch);
            steps += batch;
            expect_agreement(problem, *oracle, steps);
        }
    }
}

TEST_P(Conformance, SaysWhatAutoMeans) {
    const Problem problem = lattice(solid({13, 7, 11}));
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    backend->upload(problem, state_at_rest(problem));
    const std::optional<Choice> choice = backend->choice();
    std::map<std::string, std::string> named;
    std::istringstream words(choice ? choice->tuning : "");
    for (std::string word; std::getline(words, word, ',');)
        named[word.substr(0, word.find('='))] = word.substr(word.find('=') + 1);
    for (const auto& [parameter, value] : spec.options.tuning) {
        if (value != "auto") continue;
        ASSERT_TRUE(named.contains(parameter)) << parameter << " in '" << words.str() << "'";
        EXPECT_NE(named[parameter], "auto");
    }
}

TEST_P(Conformance, UploadRewindsAndRepeatsToTheBit) {
    const Problem problem = lattice(random_grid({19, 17, 13}, 0.5, 9));
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    const State start = random_state(problem, 0.05, 8);
    const State once = stepped(*backend, problem, start, 10);
    const std::string fingerprint = backend->state_fingerprint();
    backend->upload(problem, start);
    for (int n = 0; n < 10; ++n) backend->step(1);
    const State again = backend->download();
    if (backend->capabilities().deterministic) {
        expect_same_bits(once, again);
        EXPECT_EQ(fingerprint, backend->state_fingerprint());
    }
    if (fingerprint.empty()) return;
    State other = start;
    other.displacement.back().z += 1e-3;
    backend->upload(problem, other);
    backend->step(10);
    EXPECT_NE(fingerprint, backend->state_fingerprint()) << "the last particle is elsewhere";
    // On displacements this start consists of the same words as `start`.
    State swapped = start;
    std::swap(swapped.displacement.front(), swapped.displacement.back());
    std::swap(swapped.increment.front(), swapped.increment.back());
    backend->upload(problem, start);
    const std::string at_start = backend->state_fingerprint();
    backend->upload(problem, swapped);
    EXPECT_NE(at_start, backend->state_fingerprint()) << "two particles have changed places";
    State faster = start;
    faster.increment.back().z += 1e-3;
    backend->upload(problem, faster);
    EXPECT_NE(at_start, backend->state_fingerprint()) << "the last particle moves otherwise";
}

TEST_P(Conformance, RewindsToTheStartThatItKeptToTheBit) {
    const Problem problem = lattice(random_grid({19, 17, 13}, 0.5, 9));
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    // Most of the body is at rest. Backends that skip resting tiles must detect that again.
    State start = random_state(problem, 0.05, 8);
    std::fill(start.displacement.begin() + 50, start.displacement.end(), glm::dvec3(0));
    std::fill(start.increment.begin() + 50, start.increment.end(), glm::dvec3(0));
    backend->upload(problem, start);
    if (!backend->keep_start()) GTEST_SKIP() << "keeps none";
    // Odd and even numbers of steps end in different buffers. What the last steps before a rewind left must
    // not be taken for the start.
    for (const int steps : {7, 10, 7}) {
        backend->rewind();
        backend->step(steps);
        const State rewound = backend->download();
        const auto fresh = spec.make();
        const State uploaded = stepped(*fresh, problem, start, steps);
        if (!backend->capabilities().deterministic) continue;
        EXPECT_EQ(rewound.displacement, uploaded.displacement) << steps << " steps";
        EXPECT_EQ(rewound.increment, uploaded.increment) << steps << " steps";
    }
}

TEST_P(Conformance, RewindsOverEditsThatCancelToTheBit) {
    const Problem problem = lattice(random_grid({13, 12, 11}, 0.7, 9));
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    if (!backend->capabilities().deterministic) GTEST_SKIP() << "two runs differ anyway";
    const State start = random_state(problem, 0.05, 8);
    backend->upload(problem, start);
    if (!backend->keep_start()) GTEST_SKIP() << "keeps none";
    Problem edited = problem;
    SpringEditor editor(edited);
    const Ball ball{{6, 5, 5}, 2.5};
    backend->step(3);
    backend->edit(edited, editor.cut(ball));
    ASSERT_NE(edited.lattice.mask, problem.lattice.mask);
    backend->step(2);
    backend->edit(edited, editor.suture(ball, 1.5));
    ASSERT_EQ(edited.lattice.mask, problem.lattice.mask);
    ASSERT_TRUE(edited.springs.empty());
    backend->step(4);
    backend->rewind();
    backend->step(7);
    const State rewound = backend->download();
    expect_same_bits(rewound, stepped(*backend, problem, start, 7));
}

// What a backend keeps for springs beyond the lattice stays when the last of them is cut, and edits go on.
TEST_P(Conformance, FollowsEditsAfterItsLastSpringBeyondTheLatticeIsCut) {
    Problem problem = lattice(solid({12, 11, 10}));
    const Plane plane{{0, 0, 4.5}, {0, 0, 1}};
    const std::vector<std::pair<std::uint32_t, std::uint32_t>> far = {
        {0, std::uint32_t(problem.particle_count() - 1)}};
    (void)SpringEditor(problem).cut(plane);
    (void)SpringEditor(problem).suture(far, 0.25);
    ASSERT_EQ(problem.springs.size(), 1u);
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    backend->upload(problem, random_state(problem, 0.05, 8));
    Problem ahead = problem, edited = problem;
    SpringEditor editor(ahead);
    for (const SpringEdit& edit : {editor.cut(far), editor.suture(plane, 1.5), editor.suture(far, 0.25)}) {
        ASSERT_FALSE(edit.empty());
        apply(edited, edit);
        backend->edit(edited, edit);
        backend->step(1);
    }
    const State midway = backend->download();
    backend->step(4);
    const State expected = stepped("cpu_reference", edited, midway, 4);
    // Four steps of float32 are off by some 1e-6. A spring that pulls from a wrong place moves its ends
    // farther.
    EXPECT_LT(differences(backend->download(), expected).max, 1e-4);
}

// High and low parts together have 48 bits in float32.
TEST_P(Conformance, ACompensatedStartKeepsItsLowParts) {
    if (spec.options.formulation != Formulation::compensated) GTEST_SKIP() << "has none";
    const Problem problem = make_lattice_problem(solid({5, 4, 3}), FACE_BITS | EDGE_BITS);
    State start = state_at_rest(problem);
    for (glm::dvec3& u : start.displacement) u = {0.1, -0.07, 0.013};
    for (glm::dvec3& v : start.increment) v = {0.011, 0.0013, -0.0007};
    backend->upload(problem, start);
    const State back = backend->download();
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            for (const auto& [list, expected] :
                 {std::pair{&back.displacement, &start.displacement}, {&back.increment, &start.increment}}) {
                const double value = (*expected)[i][axis];
                EXPECT_NEAR((*list)[i][axis], value, std::abs(value) * 0x1p-48)
                    << "particle " << i << ", axis " << axis;
            }
        }
    }
}

// A body at rest needs no lists in its state.
TEST_P(Conformance, AnEmptyListOfTheStartHasTheBitsOfZeros) {
    Problem problem = lattice(random_grid({19, 17, 13}, 0.5, 9));
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    if (!backend->capabilities().deterministic) GTEST_SKIP() << "two runs differ anyway";
    const State moving = random_state(problem, 0.05, 8), rest = state_at_rest(problem);
    const Problem uploaded = problem;
    SpringEditor editor(problem);
    const SpringEdit cut = editor.cut(Ball{{9, 8, 6}, 3});
    ASSERT_FALSE(cut.empty());
    for (const auto& [empty, full] : starts_without_zeros(moving, rest)) {
        SCOPED_TRACE(std::string("displacements: ") + (empty.displacement.empty() ? "none" : "some") +
                     ", increments: " + (empty.increment.empty() ? "none" : "some"));
        const auto other = spec.make();
        backend->upload(uploaded, empty);
        other->upload(uploaded, full);
        if (backend->keep_start()) {
            backend->step(3);
            backend->rewind();
        }
        expect_same_bits(backend->download(), other->download());
        for (Backend* const one : {backend.get(), other.get()}) {
            one->step(4);
            one->edit(problem, cut);
            one->step(5);
        }
        const State end = backend->download();
        ASSERT_EQ(end.displacement.size(), problem.particle_count());
        EXPECT_NE(end.displacement, full.displacement);
        expect_same_bits(end, other->download());
    }
}

// OpenGL leaves the rounding of its root to the driver, and the paper's formula drifts.
TEST_P(Conformance, RestStaysRestToTheBit) {
    // The paper's formula rounds 2 - lambda and 1 - lambda separately: a force in proportion to the absolute
    // position.
    const Formulation formulation = spec.options.formulation;
    if (formulation == Formulation::paper) GTEST_SKIP() << "not promised by the paper's step";
    if (spec.root_error() > 0 && !by_increments(formulation))
        GTEST_SKIP() << "an approximate root finds other lengths than those at rest";
    Problem problem = make_lattice_problem(random_grid({12, 11, 10}, 0.8, 3), NEIGHBOUR_BITS);
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem))
        problem = make_lattice_problem(random_grid({12, 11, 10}, 0.8, 3), FACE_BITS | EDGE_BITS);
    if (!backend->unsupported(problem).empty() && may_refuse(spec, problem)) GTEST_SKIP();
    problem.time_step = 0.25;
    problem.damping = 0.01;
    const State rest = state_at_rest(problem);
    const State state = stepped(*backend, problem, rest, 1000);
    expect_same_bits(state, rest);
}

// --- The tool --------------------------------------------------------------------------------------------

/// `problem` with a tool that took hold of every ninth particle at its place in `start`.
Problem held_by_a_tool(Problem problem, const State& start) {
    Tool tool{.particles = {}, .held = {}, .stiffness = 0.125};
    for (std::uint32_t i = 0; i < problem.particle_count(); i += 9) {
        tool.particles.push_back(i);
        tool.held.push_back(start.displacement[i]);
    }
    take_hold(problem, tool);
    return problem;
}

bool may_refuse_a_tool(const BackendSpec& spec) {
    const std::string& backend = spec.entry->name;
    return backend == "cuda_bricks" || backend == "cuda_march" || backend == "cuda_tiles";
}

/// Backends at their default tuning, and with the tunings that concern the tool. Other tunings are left out
/// since each scene would compile another shader, which takes long.
std::vector<std::string> with_a_tool() {
    std::vector<std::string> all = in_every_formulation();
    for (const std::string& spec : in_every_formulation("ticks")) all.push_back(spec + ",ticks=resident");
    return all;
}

class ConformanceWithATool : public Conformance {};

TEST_P(ConformanceWithATool, PullsAsInTheReference) {
    std::vector<std::string> chosen = {"loads", "network_without_a_grid"};
    if (backend->capabilities().steps_on_host()) chosen.insert(chosen.end(), {"several_labels", "pinned"});
    for (const std::string& name : chosen) {
        SCOPED_TRACE(name);
        const Problem& without = cases().at(name);
        if (!backend->unsupported(without).empty()) continue;
        const State start = random_state(without, 0.05, 7);
        const Problem problem = held_by_a_tool(without, start);
        if (const std::string why = backend->unsupported(problem); !why.empty()) {
            EXPECT_TRUE(may_refuse_a_tool(spec)) << "unsupported: " << why;
            EXPECT_EQ(backend->tool(), nullptr);
            continue;
        }
        const auto oracle = BackendSpec::parse("cpu_reference").make();
        oracle->upload(problem, start);
        backend->upload(problem, start);
        EXPECT_EQ(backend->tool()->tool_force(), glm::dvec3(0));
        int steps = 0;
        for (const glm::dvec3& moved :
             {glm::dvec3(0.05, 0, 0), glm::dvec3(0.05, -0.1, 0.02), glm::dvec3(-0.1, 0, 0.1)}) {
            for (Backend* const b : {oracle.get(), backend.get()}) {
                b->tool()->move_tool(moved);
                b->step(1);
                b->step(4);
            }
            steps += 5;
            const Comparison comparison = expect_agreement(problem, *oracle, steps);
            // Each force is the stiffness times a distance, whose end is off by no more than particles are.
            const double tolerance = double(problem.tool.particles.size()) * problem.tool.stiffness *  //
                                     2 * comparison.tolerance;
            const glm::dvec3 force = oracle->tool()->tool_force();
            EXPECT_LT(glm::distance(backend->tool()->tool_force(), force), tolerance)
                << "after " << steps << " steps";
            EXPECT_GT(glm::length(force), tolerance) << "tells nothing";
        }
    }
}

TEST_P(ConformanceWithATool, ThatPullsNobodyChangesNoBitAndARewindLetsItRest) {
    if (spec.options.formulation != spec.entry->formulations.front()) GTEST_SKIP() << "one is enough";
    const Problem without = lattice(random_grid({11, 9, 10}, 0.7, 9));
    const State start = random_state(without, 0.05, 8);
    Problem problem = held_by_a_tool(without, start);
    if (!backend->unsupported(problem).empty()) GTEST_SKIP() << "has no tool";
    const auto play = [&](const Problem& played) { return stepped(*backend, played, start, 7); };
    const State plain = play(without);
    const State pulled = play(problem);
    EXPECT_NE(pulled.displacement, plain.displacement);
    if (backend->keep_start()) {
        backend->upload(problem, start);
        ASSERT_TRUE(backend->keep_start());
        backend->tool()->move_tool({0.3, 0.2, 0.1});
        backend->step(3);
        backend->rewind();
        EXPECT_EQ(backend->tool()->tool_force(), glm::dvec3(0));
        backend->step(7);
        if (backend->capabilities().deterministic) expect_same_bits(backend->download(), pulled);
    }
    // A spring without stiffness.
    problem.tool.stiffness = 0;
    const State held = play(problem);
    if (backend->capabilities().deterministic) expect_same_bits(held, plain);
    EXPECT_EQ(backend->tool()->tool_force(), glm::dvec3(0));
}

// Each of these calls, and the pause by itself, ends a kernel that waits for the next tick.
TEST_P(ConformanceWithATool, GivesTheSameBitsWhateverComesBetweenTicks) {
    if (spec.options.formulation != spec.entry->formulations.front()) GTEST_SKIP() << "one is enough";
    const Problem without = lattice(random_grid({11, 9, 10}, 0.8, 9));
    const State start = random_state(without, 0.05, 8);
    const Problem problem = held_by_a_tool(without, start);
    if (!backend->unsupported(problem).empty()) GTEST_SKIP() << "has no tool";
    if (!backend->capabilities().deterministic) GTEST_SKIP() << "two runs differ anyway";
    const auto& tuning = spec.options.tuning;
    const bool ends_by_itself = tuning.contains("ticks") && tuning.at("ticks") == "resident";
    Problem played[] = {problem, problem};
    const auto play = [&](bool interrupted) {
        backend->monitor(interrupted ? DivergenceMonitor{1e6, 3} : DivergenceMonitor{});
        Problem& now = played[interrupted ? 1 : 0];
        SpringEditor editor(now);
        backend->upload(problem, start);
        for (int n = 0; n < 8; ++n) {
            backend->tool()->move_tool({0.05 * n, -0.02 * n, 0});
            backend->step(n % 3 + 1);
            if (n == 4) backend->edit(now, editor.cut(Ball{{5, 4, 5}, 1.5}));
            if (!interrupted) continue;
            if (n % 2 == 0) (void)backend->tool()->tool_force();
            if (n == 1) backend->synchronize();
            if (n == 2) (void)backend->download();
            if (n == 3) (void)backend->divergence();
            if (n == 6 && ends_by_itself) std::this_thread::sleep_for(std::chrono::milliseconds(1500));
        }
        const glm::dvec3 force = backend->tool()->tool_force();
        State end = backend->download();
        EXPECT_EQ(backend->tool()->tool_force(), force);
        EXPECT_EQ(backend->divergence(), std::nullopt);
        // A tick is under way when another upload comes.
        backend->step(1);
        return std::pair(end, force);
    };
    const auto [plain, force] = play(false);
    const auto [interrupted, force_there] = play(true);
    expect_same_bits(interrupted, plain);
    EXPECT_EQ(force_there, force);
}

TEST_P(ConformanceWithATool, CostsNothingWhereThereIsNone) {
    if (spec.options.formulation != spec.entry->formulations.front()) GTEST_SKIP() << "one is enough";
    const Problem without = lattice(solid({9, 8, 7}));
    const State start = state_at_rest(without);
    const Problem problem = held_by_a_tool(without, start);
    if (!backend->unsupported(problem).empty()) GTEST_SKIP() << "has no tool";
    const auto work_of = [&](const Problem& played) {
        backend->upload(played, start);
        backend->step(2);
        return backend->count_work();
    };
    const WorkCount fresh = work_of(without), held = work_of(problem), again = work_of(without);
    EXPECT_EQ(fresh, again);
    if (fresh.contains("compute_shader_invocations")) {
        const std::uint64_t group = 64;  // of shaders/tool.comp
        EXPECT_EQ(held.at("compute_shader_invocations"), fresh.at("compute_shader_invocations") + group);
    }
    // Loads are left out of the comparison, since a scene with a tool has them.
    Problem loaded = without;
    loaded.load.assign(loaded.particle_count(), glm::dvec3(0));
    EXPECT_EQ(spec.entry->bytes(problem, spec.options), spec.entry->bytes(loaded, spec.options));
}

// --- Edits ---------------------------------------------------------------------------------------------

std::map<std::string, Problem> edit_cases() {
    std::map<std::string, Problem> all;
    all["dense"] = lattice(random_grid({11, 9, 10}, 0.95, 31));
    // Rows long enough for whole registers of particles with every neighbour.
    all["solid"] = lattice(solid({37, 5, 7}));
    // Only a suture joins its two layers.
    all["apart"] = lattice(solid({2, 9, 8}));
    SpringEditor(all["apart"]).cut(Plane{{0.5, 0, 0}, {1, 0, 0}});
    all["all_groups_pinned"] = pinned(lattice(random_grid({8, 7, 9}, 0.8, 32), NEIGHBOUR_BITS));
    all["labels"] = lattice(random_grid({9, 8, 7}, 0.9, 33, 2));
    all["labels"].materials = {{1, 1}, {2, 0.25}};
    all["network"] = with_dynamics(random_network(200, 700, 34));
    return all;
}

template <class Visit>
void Conformance::for_each_edited(Visit visit) const {
    for (const auto& [name, problem] : edit_cases()) {
        for (const bool beyond : {false, true}) {
            SCOPED_TRACE(name + (beyond ? " beyond the lattice" : ""));
            Problem edited = problem;
            const std::vector<SpringEdit> edits = edit_everything(edited, beyond);
            if (backend->unsupported(problem).empty() && backend->unsupported(edited).empty()) {
                visit(problem, edits, edited);
            } else {
                EXPECT_TRUE(may_refuse(spec, edited));
            }
        }
    }
}

TEST_P(Conformance, AnEditedProblemIsTheOneBuiltSoToTheBit) {
    for_each_edited([&](const Problem& problem, const std::vector<SpringEdit>& edits, const Problem& edited) {
        const State start = random_state(problem, 0.05, 7);
        const auto play = [&](const Problem& from, const std::vector<SpringEdit>& changes) {
            Problem now = from;
            backend->upload(from, start);
            for (const SpringEdit& edit : changes) {
                apply(now, edit);
                backend->edit(now, edit);
            }
            backend->step(13);
            return backend->download();
        };
        const State played = play(problem, edits);
        const State built = play(edited, {});
        if (backend->capabilities().deterministic) {
            expect_same_bits(played, built);
        } else {
            const Comparison comparison = compared(edited, played, built, 13);
            EXPECT_TRUE(comparison.passed()) << comparison.reason;
        }
        // An upload forgets every edit.
        const auto oracle = BackendSpec::parse("cpu_reference").make();
        for (Backend* b : {oracle.get(), backend.get()}) {
            b->upload(problem, start);
            b->step(5);
        }
        expect_agreement(problem, *oracle, 5);
    });
}

TEST_P(Conformance, EditsBetweenStepsAgreeWithTheReference) {
    for_each_edited([&](const Problem& problem, const std::vector<SpringEdit>& edits, const Problem&) {
        const State start = random_state(problem, 0.05, 8);
        const auto oracle = BackendSpec::parse("cpu_reference").make();
        Problem now = problem;
        for (Backend* b : {oracle.get(), backend.get()}) b->upload(problem, start);
        int steps = 0;
        for (const SpringEdit& edit : edits) {
            for (Backend* b : {oracle.get(), backend.get()}) b->step(3);
            apply(now, edit);
            for (Backend* b : {oracle.get(), backend.get()}) {
                b->edit(now, edit);
                b->step(2);
            }
            steps += 5;
            expect_agreement(now, *oracle, steps);
        }
        // The state has the bits of a fresh upload: a float32 state passes through download() and upload()
        // unchanged, since the difference of two of its positions is rounded in float64. This does not hold
        // for a state of two parts, which together have more bits than a float64.
        const bool exact = spec.options.precision == Precision::float32 &&
                           spec.options.formulation != Formulation::compensated;
        if (!exact || !backend->capabilities().deterministic) return;
        const State midway = backend->download();
        backend->step(5);
        const State played = backend->download();
        expect_same_bits(played, stepped(*backend, now, midway, 5));
    });
}

TEST_P(Conformance, EditsLeavePinnedParticlesWhereTheyAre) {
    const Problem problem = pinned(lattice(random_grid({8, 7, 9}, 0.9, 36)));
    if (!backend->unsupported(problem).empty()) {
        EXPECT_TRUE(may_refuse(spec, problem));
        return;
    }
    State state = random_state(problem, 0.05, 9);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (problem.is_pinned(i)) state.displacement[i] = glm::dvec3(0);
    }
    backend->upload(problem, state);
    Problem now = problem;
    SpringEditor editor(now);
    const Shape across = Plane{{3.5, 0, 0}, {1, 0, 0}};
    for (const bool cut : {true, false}) {
        const SpringEdit edit = cut ? editor.cut(across) : editor.suture(across, 1.5);
        ASSERT_TRUE(std::any_of(edit.touched.begin(), edit.touched.end(),
                                [&](const auto& touched) { return problem.is_pinned(touched.particle); }));
        if (!backend->unsupported(now).empty()) break;
        backend->edit(now, edit);
        backend->step(7);
        const State after = backend->download();
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            if (!problem.is_pinned(i)) continue;
            // To the bit: rest positions on this lattice are whole numbers.
            EXPECT_EQ(after.displacement[i], glm::dvec3(0)) << "particle " << i;
            EXPECT_EQ(after.increment[i], glm::dvec3(0)) << "particle " << i;
        }
    }
}

/// Every backend with its defaults, then with each other precision, formulation and tuning value by itself.
std::vector<std::string> every_specification() {
    std::vector<std::string> specs;
    for (const auto& [name, entry] : registry()) {
        if (name == "cpu_reference") continue;
        for (const Precision precision : entry.precisions) {
            const std::string base = name + ":precision=" + to_string(precision);
            specs.push_back(base);
            for (std::size_t f = 1; f < entry.formulations.size(); ++f)
                specs.push_back(base + ",formulation=" + to_string(entry.formulations[f]));
            for (const auto& [key, values] : entry.tuning) {
                if (key == "root" && precision == Precision::float64) continue;  // only float32 has it
                for (std::size_t v = 1; v < values.size(); ++v)
                    specs.push_back(base + "," + key + "=" + values[v]);
            }
        }
    }
    return specs;
}

/// CUDA's specifications of the study as_paper, whose tuning parameters differ from the default all at once.
std::vector<std::string> as_the_paper_had_them() {
    std::vector<std::string> specs;
    const Study study = load_study("as_paper");
    for (const BackendSpec& spec : known_specs(study, study.scenes.front())) {
        if (spec.entry->api == "cuda")
            specs.push_back(spec.entry->name + ":precision=float32,formulation=paper," + spec.tuning());
    }
    return specs;
}

/// Approximate roots on each SIMD target of this processor, with the error of that target: once with forces
/// from the strain, and once with forces from a difference of lengths.
std::vector<std::string> roots_on_every_target() {
    std::vector<std::string> specs;
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        const std::string on = std::string("@") + hwy::TargetName(target);
        for (const Formulation formulation : {Formulation::increment, Formulation::position})
            specs.push_back("cpu_parallel:precision=float32,formulation=" + to_string(formulation) +
                            ",root=raw" + on);
        specs.push_back("cpu_parallel:precision=float32,root=refined" + on);
    }
    return specs;
}

INSTANTIATE_TEST_SUITE_P(Backends, Conformance, ::testing::ValuesIn(every_specification()), test_name);
INSTANTIATE_TEST_SUITE_P(AsPaper, Conformance, ::testing::ValuesIn(as_the_paper_had_them()), test_name);
INSTANTIATE_TEST_SUITE_P(SimdTargets, Conformance, ::testing::ValuesIn(roots_on_every_target()), test_name);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(Conformance);
INSTANTIATE_TEST_SUITE_P(Backends, ConformanceWithATool, ::testing::ValuesIn(with_a_tool()), test_name);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(ConformanceWithATool);

}  // namespace
}  // namespace voxspring::testing
