// Tests of all backends of shaders, whichever API runs them: skipped terms and tuning change no bit, edits
// and steps keep their order, and the counts of a step and the bytes of an upload are right.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/required.h"
#include "tests/shader_support.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

/// Each of the backends of OpenGL and Vulkan in each formulation.
class ComputeShader : public BackendTest {
protected:
    static std::unique_ptr<Backend> make(const std::string& specification) {
        return BackendSpec::parse(specification).make();
    }

    const Formulation formulation = spec.options.formulation;
    const bool lists = spec.entry->addressing == Addressing::by_lists;
    const bool draws = spec.entry->tuning.contains("mask");  ///< steps in fragment shaders
};

/// The backends of shaders that are in this build.
std::vector<std::string> shader_backends() {
    std::vector<std::string> names;
    for (const auto& [name, entry] : registry()) {
        if (entry.api == "opengl" || entry.api == "vulkan") names.push_back(name);
    }
    return names;
}

INSTANTIATE_TEST_SUITE_P(, ComputeShader, ::testing::ValuesIn(formulations_of(shader_backends())), test_name);

/// Scenes that lack one term each, and some that lack most.
std::vector<std::pair<std::string, Problem>> scenes_to_skip_in() {
    std::vector<std::pair<std::string, Problem>> scenes = {{"nothing but face springs", plain_problem()}};
    const std::pair<const char*, void (*)(Problem&)> changes[] = {
        {"nothing to skip", [](Problem&) {}},
        {"no damping", [](Problem& problem) { problem.damping = 0; }},
        {"no gravity", [](Problem& problem) { problem.gravity = glm::dvec3(0); }},
        {"no loads", [](Problem& problem) { problem.load.clear(); }},
        {"no pins",
         [](Problem& problem) { pin(problem, std::vector<std::uint8_t>(problem.particle_count(), 0)); }},
        {"one material",
         [](Problem& problem) {
             problem.material.clear();
             problem.materials = {{1.3, 1}};
             problem.group_stiffness = {0.9, 0.7, 0.3};
         }},
        {"stressed at rest", [](Problem& problem) {
             for (double& length : problem.rest_length) length *= 0.97;
         }}};
    for (const auto& [name, change] : changes) {
        scenes.emplace_back(name, problem_with_everything());
        change(scenes.back().second);
    }
    for (const std::uint32_t groups : {FACE_BITS, EDGE_BITS, CORNER_BITS, FACE_BITS | EDGE_BITS}) {
        Problem problem = make_lattice_problem(random_grid({13, 11, 9}, 0.67, 11), groups);
        problem.time_step = 0.2;
        problem.gravity = {0, 0, -2e-3};
        scenes.emplace_back("some groups", problem);
    }
    return scenes;
}

// The state also follows the reference.
TEST_P(ComputeShader, SkippedTermsChangeNoBit) {
    const auto skipping = BackendSpec::parse(GetParam() + ",terms=needed").make();
    const auto with_all = BackendSpec::parse(GetParam() + ",terms=all").make();
    const auto oracle = BackendSpec::parse("cpu_reference").make();
    for (const auto& [name, scene] : scenes_to_skip_in()) {
        SCOPED_TRACE(name);
        const State needed = after(*skipping, scene, 20);
        expect_same_bits(needed, after(*with_all, scene, 20));
        const Comparison comparison =
            compare(scene, needed, after(*oracle, scene, 20), Precision::float32, 20);
        EXPECT_TRUE(comparison.passed()) << comparison.reason;
    }
}

TEST_P(ComputeShader, HowItIsTunedChangesNoBit) {
    std::vector<Problem> problems = {problem_with_everything()};
    if (lists) {
        problems.push_back(problems[0]);
        const auto last = std::uint32_t(problems[0].particle_count() - 1);
        problems[1].springs = {{0, last, 0.1, 9}, {1, last - 2, 0.2, 8}, {0, 1, 0.3, 1}};
    }
    for (const Problem& problem : problems) {
        const State state = after(*make(GetParam()), problem, 20);
        for (const auto& [key, values] : spec.entry->tuning) {
            for (std::size_t v = 1; v < values.size(); ++v) {
                SCOPED_TRACE(key + "=" + values[v]);
                expect_same_bits(after(*make(GetParam() + "," + key + "=" + values[v]), problem, 20), state);
            }
        }
    }
}

TEST_P(ComputeShader, CountedStepIsAStep) {
    const Problem problem = problem_with_everything();
    backend->upload(problem, random_state(problem, 0.05, 3));
    backend->step(4);
    const WorkCount work = backend->count_work();
    EXPECT_GT(work.at(draws ? "samples_passed" : "work_groups"), 0u);
    const auto invocations = work.find("compute_shader_invocations");
    if (invocations != work.end()) {
        EXPECT_GE(invocations->second, problem.particle_count());
    }
    expect_same_bits(backend->download(), after(*make(GetParam()), problem, 5));
}

// An edit waits for the steps before it, and the steps after it wait for the edit.
TEST_P(ComputeShader, EditsAndStepsKeepTheirOrder) {
    // There are enough steps and edits in flight that one out of order would show.
    Problem problem = make_lattice_problem(solid({24, 24, 24}), FACE_BITS | EDGE_BITS);
    problem.gravity = {8e-4, 0, -2e-3};
    problem.time_step = 0.2;
    pin_base(problem);
    Problem edited = problem;
    SpringEditor editor(edited);
    std::vector<SpringEdit> edits;
    for (int n = 0; n < 4; ++n) {
        const Plane plane{{11.5, 0, 6.0 * n}, {1, 0, 0.3}};
        edits.push_back(editor.cut(plane));
        edits.push_back(editor.suture(plane, 1.5));
    }
    const auto play = [&](bool waits) {
        const auto fresh = spec.make();
        Problem now = problem;
        fresh->upload(problem, random_state(problem, 0.05, 3));
        for (const SpringEdit& edit : edits) {
            fresh->step(3);
            if (waits) fresh->synchronize();
            apply(now, edit);
            fresh->edit(now, edit);
            if (waits) fresh->synchronize();
        }
        fresh->step(3);
        return fresh->download();
    };
    expect_same_bits(play(false), play(true));
}

TEST_P(ComputeShader, LosesNoMoreThanItsFormulationDoes) {
    Problem problem = make_lattice_problem(solid({12, 12, 12}), FACE_BITS | EDGE_BITS);
    problem.gravity = {8e-4, 0, -2e-3};
    problem.time_step = 0.25;  // its square is exact in float32
    pin_base(problem);
    const int steps = 300;
    const auto run = [&](const std::string& specification) {
        return stepped(specification, problem, state_at_rest(problem), steps);
    };
    const Comparison comparison =
        compare(problem, run(GetParam()), run("cpu_reference"), Precision::float32, steps);
    EXPECT_TRUE(comparison.passed()) << comparison.reason;
    // Measured on llvmpipe, in either API: 1.3e-4, 1.4e-4, 5.4e-6, 4.2e-7, 5.4e-8.
    const double most[] = {5e-4, 5e-4, 1.7e-5, 1.5e-6, 1.7e-7};
    EXPECT_LE(comparison.relative_l2, most[std::size_t(formulation)]);
}

TEST_P(ComputeShader, EstimatesItsBytes) {
    const Problem box = make_lattice_problem(solid({32, 32, 32}), FACE_BITS | EDGE_BITS);
    const auto bytes = [&](const Problem& problem, const std::string& tuning) {
        return spec.entry->bytes(problem, BackendSpec::parse(GetParam() + tuning).options);
    };
    // Storage buffers: two words of 16 bytes; with increments 12 more; twice that for low parts. Textures:
    // vectors of 16 bytes and one byte for the stencil. Lists of 18 neighbours.
    const bool increments = by_increments(formulation);
    const std::uint64_t parts = formulation == Formulation::compensated ? 2 : 1;
    const std::uint64_t state =
        draws ? 16 * (increments ? 4 * parts : 3) + 1 : parts * (2 * 16 + (increments ? 12 : 0));
    const std::uint64_t expected = box.particle_count() * (state + (lists ? 18 * 4 : 0));
    const std::uint64_t plain = bytes(box, "");
    EXPECT_GE(plain, expected);
    // Guard words: a little more than two slices.
    EXPECT_LE(double(plain), (draws ? 1.02 : 1.08) * double(expected));
    if (draws) {
        EXPECT_LT(bytes(box, ",mask=none"), plain);
    }
    EXPECT_GT(bytes(box, ",terms=all"), plain);
    EXPECT_GT(bytes(problem_with_everything(), ""), bytes(plain_problem(), ""));
    if (!lists) return;
    // The constants of each of up to 18 springs and, on displacements, their offsets at rest.
    Problem sutured = box;
    sutured.springs.push_back({0, 77, 1, 3});
    EXPECT_EQ(bytes(sutured, "") - plain,
              box.particle_count() * 18 * (on_positions(formulation) ? 8 : 8 + 16));
}

TEST_P(ComputeShader, OnlyWorkGroupsWithAnActiveVoxelAreDispatched) {
    if (lists || draws) return;  // these have no groups of voxels
    const Problem corners = make_lattice_problem(
        make_grid({128, 16, 16}, [](int x, int y, int z) { return (x < 3 || x > 120) && y < 3 && z < 2; }),
        FACE_BITS);
    const auto blocked = make(GetParam() + ",block=32x4x2");
    blocked->upload(corners, state_at_rest(corners));
    EXPECT_EQ(blocked->count_work().at("work_groups"), 2u);
}

/// The state after `count` steps of a few particles, handed over in calls of `batches` steps in turn.
State in_batches(Backend& backend, const Problem& problem, int count, const std::vector<int>& batches) {
    backend.upload(problem, random_state(problem, 0.05, 3));
    for (std::size_t n = 0; count > 0; ++n) {
        const int batch = std::min(count, batches[n % batches.size()]);
        backend.step(batch);
        count -= batch;
    }
    return backend.download();
}

TEST_P(ComputeShader, HowStepsAreHandedOverChangesNoBit) {
    const Problem problem = plain_problem();
    // More steps than any recording or submission holds, an odd number, and batches that begin at odd and
    // even steps.
    const State at_once = in_batches(*backend, problem, 1355, {1355});
    for (const std::vector<int>& batches : std::vector<std::vector<int>>{{1}, {7, 2}, {64, 1}, {257, 512}})
        expect_same_bits(in_batches(*backend, problem, 1355, batches), at_once);
}

TEST_P(ComputeShader, DeviceTimeAgreesWithHostTime) {
    Problem problem = make_lattice_problem(solid({32, 32, 32}), FACE_BITS | EDGE_BITS);
    problem.time_step = 0.25;
    backend->upload(problem, state_at_rest(problem));
    backend->step(4);
    Timing timing = backend->timed([&] { backend->step(4); });
    // Enough steps that neither starting the first nor waiting for the last matters: 50 ms.
    const int steps = int(4 * std::ceil(0.05 / timing.host_seconds)) + 4;
    timing = backend->timed([&] { backend->step(steps); });
    // The marks lie between the readings of the host clock; the clocks differ by parts in a million. A clock
    // that stops while steps run, or that counts what follows them, misses half of it or more.
    EXPECT_LE(timing.device_seconds, 1.001 * timing.host_seconds);
    EXPECT_GE(timing.device_seconds, 0.5 * timing.host_seconds);
}

}  // namespace
}  // namespace voxspring::testing
