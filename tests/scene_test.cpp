// Scenes: the built-in ones, what a file's keys become, and how each kind of bad input is refused.
#include "harness/scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "backends/physics/neighbours.h"
#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/export/export_formats.h"
#include "harness/scene/parts.h"
#include "harness/scene/scene_file.h"
#include "harness/scene/scene_runner.h"
#include "harness/scene/stability.h"
#include "tests/support.h"
#include "tests/volume_files.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;
using ::testing::ThrowsMessage;

constexpr SceneSizeLimits small{100000, 10000};

Scene parse(const std::string& text) { return parse_scene(text, "scene", small); }

/// A scene of a 4 x 3 x 2 box, with additional keys.
Scene box_with(const std::string& keys) {
    return parse(R"({"dataset": {"type": "box", "dims": [4, 3, 2]}, )" + keys + "}");
}

/// A scene file in a folder, of a volume file there, with further keys of its dataset and of the scene.
Scene volume_scene(const TemporaryFolder& folder, const std::string& volume, const std::string& dataset = "",
                   const std::string& keys = "") {
    return load_scene(folder.write("s.json", R"({"dataset": {"type": "volume", "file": ")" + volume + "\"" +
                                                 dataset + "}" + keys + "}"),
                      small);
}

/// Writes a volume of bytes, "v.nrrd", with these fields.
void write_volume(const TemporaryFolder& folder, const std::string& fields, const std::string& data) {
    folder.write("v.nrrd", nrrd_file("type: uint8\nencoding: raw\n" + fields + "\n", data));
}

std::vector<std::size_t> pinned_particles(const Problem& problem) {
    std::vector<std::size_t> list;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (problem.is_pinned(i)) list.push_back(i);
    }
    return list;
}

TEST(Scene, BuiltinScenesHaveTheirCounts) {
    struct Expected {
        std::string argument;
        std::size_t voxels, particles;
        std::uint64_t springs;
        std::size_t pinned;
    };
    for (const Expected& expected :
         {Expected{"box", 32768, 32768, 279744, 1024}, Expected{"heart", 140760, 29449, 220507, 8188},
          Expected{"heart@120x102x92", 1126080, 236609, 1949461, 68965},
          Expected{"beam", 8192, 8192, 63456, 64}, Expected{"free", 13824, 13824, 115920, 0},
          Expected{"poke", 262144, 262144, 2298240, 0}, Expected{"poke@1x2x3", 6, 6, 11, 0},
          Expected{"porous", 32768, 31124, 252327, 966}, Expected{"porous@48", 110592, 105070, 867620, 2184},
          Expected{"box@5", 125, 125, 780, 25}}) {
        SCOPED_TRACE(expected.argument);
        const Scene scene = load_scene(expected.argument);
        EXPECT_EQ(scene.name, expected.argument);
        EXPECT_EQ(scene.problem.lattice.voxel_count(), expected.voxels);
        EXPECT_EQ(scene.problem.particle_count(), expected.particles);
        EXPECT_EQ(count_springs(scene.problem).total(), expected.springs);
        EXPECT_EQ(pinned_particles(scene.problem).size(), expected.pinned);
        EXPECT_EQ(scene.problem.time_step, 0.5 * scene.stable_time_step);
        EXPECT_FALSE(scene.description.empty());
    }
}

TEST(Scene, EveryBuiltinSceneIsListedAndLoads) {
    std::vector<std::string> names;
    for (const Named& scene : builtin_scenes()) {
        names.push_back(scene.name);
        EXPECT_EQ(load_scene(scene.name).description, scene.description);
    }
    EXPECT_EQ(names, (std::vector<std::string>{"beam", "box", "free", "grasp", "heart", "incision", "poke",
                                               "porous", "press", "scalpel_1", "scalpel_10", "scalpel_100"}));
}

TEST(Scene, PokeMovesOnlyTheCorner) {
    for (const std::string dims : {"", "@8"}) {
        const Scene scene = load_scene("poke" + dims);
        EXPECT_EQ(scene.problem.gravity, glm::dvec3(0));
        EXPECT_NEAR(glm::length(scene.state.displacement[0]), 0.3, 1e-15);
        EXPECT_EQ(std::count(scene.state.displacement.begin(), scene.state.displacement.end(), glm::dvec3(0)),
                  std::ptrdiff_t(scene.problem.particle_count()) - 1);
        EXPECT_TRUE(scene.state.increment.empty());
    }
}

TEST(Scene, EditsAreFoundOneAfterTheOther) {
    const Scene scene = box_with(R"("edits": [
        {"step": 30, "suture": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}, "within": 1.5}},
        {"step": 10, "cut": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}}},
        {"step": 40, "cut": {"ball": {"centre": [0, 0, 0], "radius": 1}},
         "repeat": {"times": 3, "every": 5, "move": [1, 0, 0]}},
        {"step": 20, "suture": {"pairs": [[[0, 0, 0], [3, 0, 0]]], "stiffness": 0.5}}])");
    std::vector<int> steps;
    Problem edited = scene.problem;
    for (const ScheduledEdit& scheduled : scene.edits) {
        steps.push_back(scheduled.step);
        apply(edited, scheduled.edit);
    }
    EXPECT_EQ(steps, (std::vector<int>{10, 20, 30, 40, 45, 50}));
    EXPECT_EQ(changed_springs(edited, scene.edits[0].edit.removed).size(),
              changed_springs(edited, scene.edits[2].edit.added).size());
    ASSERT_EQ(edited.springs.size(), 1u);
    EXPECT_EQ(edited.springs[0].rest_length, 3);
    EXPECT_EQ(edited.springs[0].stiffness, 0.5);
    // The stiffer body has the shorter stable step, and the scene's default follows it.
    const Scene stiff = box_with(R"("edits": [
        {"step": 1, "suture": {"pairs": [[[0, 0, 0], [3, 0, 0]]], "stiffness": 100}}])");
    EXPECT_LT(stiff.stable_time_step, scene.stable_time_step / 2);
    EXPECT_EQ(stiff.problem.time_step, 0.8 * stiff.stable_time_step);
}

TEST(Scene, ManyEditsTakeLittleMemory) {
    // A blade through the middle and its suture, a thousand times each: 400 particles on either side of the
    // cut.
    const std::string plane = R"("plane": {"point": [9.5, 0, 0], "normal": [1, 0, 0]})";
    const std::string often = R"("repeat": {"times": 1000, "every": 2}})";
    const auto held = [] { return mallinfo2().uordblks + mallinfo2().hblkhd; };
    const std::size_t before = held();
    const Scene scene = parse(R"({"dataset": {"type": "box", "dims": [20, 20, 20]}, "edits": [
        {"step": 1, "cut": {)" +
                              plane + "}, " + often + R"(, {"step": 2, "suture": {)" + plane +
                              R"(, "within": 1.5}, )" + often + "]}");
    ASSERT_EQ(scene.edits.size(), 2000u);
    constexpr std::size_t mebibyte = std::size_t(1) << 20;
    EXPECT_LT(held() - before, 25 * mebibyte) << "400 KiB an edit as backends are told of it";
    const SceneRunner runner(scene);
    EXPECT_LT(held() - before, 45 * mebibyte);
}

constexpr const char* samples = "time,x,y,z\n0.5,1,1,1\n1,1.5,1,1\r\n2,1.5,0,3\n";

TEST(ToolMotion, IsStraightBetweenSamplesAndRestsBeforeAndAfter) {
    const ToolMotion motion = parse_tool_motion(samples, "hand.csv", 2, 10);
    EXPECT_EQ(motion.time, (std::vector<double>{0, 1, 3}));
    EXPECT_EQ(motion.at(-1), glm::dvec3(0));
    EXPECT_EQ(motion.at(0.5), glm::dvec3(2.5, 0, 0));
    EXPECT_EQ(motion.at(1), glm::dvec3(5, 0, 0));
    EXPECT_EQ(motion.at(2), glm::dvec3(5, -5, 10));
    EXPECT_EQ(motion.at(99), glm::dvec3(5, -10, 20));
    EXPECT_EQ(ToolMotion{}.at(1), glm::dvec3(0));
}

TEST(ToolMotion, WhatProgramsPutAroundNumbersIsReadOver) {
    const ToolMotion plain = parse_tool_motion(samples, "hand.csv", 1, 1);
    for (const std::string text : {"\xEF\xBB\xBFtime,x,y,z\r\n0.5,1,1,1\r\n1,1.5,1,1\r\n2,1.5,0,3\r\n",
                                   "time, x, y, z\n0.5, 1, 1, 1\n1,\t1.5, 1, 1\n2 , 1.5 ,0, 3",
                                   "time,x,y,z\n0.5,1,1,1\n1,1.5,1,1\n2,1.5,0,3\n\n \r\n"}) {
        const ToolMotion motion = parse_tool_motion(text, "hand.csv", 1, 1);
        EXPECT_EQ(motion.time, plain.time) << text;
        EXPECT_EQ(motion.displacement, plain.displacement) << text;
    }
}

TEST(ToolMotion, BadFilesAreRefused) {
    const std::string head = "time,x,y,z\n", still = head + "0,0,0,0\n1,0,0,0\n";
    const std::pair<std::string, std::string> cases[] = {
        {"0,1,2,3\n", "line 1: 0,1,2,3"},
        {head + "0,1,2\n", "line 2: 0,1,2"},
        {head + "0,1,2,3\n1,1,,3\n", "line 3, y: "},
        {head + "0,1,nan,3\n", "line 2, y: nan"},
        {head + "0,1,2,inf\n", "line 2, z: inf"},
        {head + "0,1,2,3x\n", "line 2, z: 3x"},
        {still + "1,0,0,0\n", "line 4, time: 1"},
        {head + "1700000000.5,0,0,0\n1700000000.25,0,0,0\n", "line 3, time: 1700000000.25"},
        {still + "2,0,0,0\n13,0,0,0\n", "line 5, time: a gap of 11"},
        {head, "0 samples"},
        {head + "0,0,0,0\n\n1,0,0,0\n", "line 3: "},
    };
    for (const auto& [text, expected] : cases)
        EXPECT_EQ(refused([&, &t = text] { (void)parse_tool_motion(t, "hand.csv", 1, 1); }), expected)
            << text;
    EXPECT_EQ(refused([] { (void)read_tool_motion("no/such.csv", 1, 1); }), "a missing file");
    // Times in messages are those of the file, whatever the scene makes of them.
    EXPECT_EQ(refused([&] { (void)parse_tool_motion(still + "2,0,0,0\n13,0,0,0\n", "hand.csv", 1e-3, 1); }),
              "line 5, time: a gap of 11");
}

TEST(Scene, AToolHoldsARegionAndMovesTickByTick) {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "hand.csv") << samples;
    const std::string file = (folder.path() / "scene.json").string();
    const Scene scene = parse_scene(R"({"dataset": {"type": "box", "dims": [4, 3, 2]}, "time_step": 0.125,
        "tool": {"side": "x+", "stiffness": 0.5, "motion": "hand.csv", "length_scale": 0.5, "every": 3}})",
                                    file, small);
    EXPECT_EQ(scene.problem.tool.particles, (std::vector<std::uint32_t>{3, 7, 11, 15, 19, 23}));
    EXPECT_EQ(scene.problem.load.size(), scene.problem.particle_count());
    EXPECT_EQ(scene.tool_motion.every, 3);
    const auto backend = BackendSpec::parse("cpu_reference").make();
    backend->upload(scene.problem, scene.state);
    for (int tick = 0; tick < 5; ++tick) {
        backend->tool()->move_tool(scene.tool_motion.at(tick * 0.375));
        backend->step(tick == 4 ? 2 : 3);
    }
    const State by_hand = backend->download();
    EXPECT_NE(by_hand.displacement[3], glm::dvec3(0));
    SceneRunner runner(scene);
    EXPECT_EQ(runner.unsupported(*backend), "");
    for (const std::vector<int>& pieces : {std::vector<int>{14}, {1, 4, 2, 7}}) {
        runner.rewind(*backend);
        for (const int steps : pieces) runner.run(*backend, steps);
        EXPECT_EQ(backend->download().displacement, by_hand.displacement);
    }
    // A stiff tool has a short time step.
    const std::string stiff = R"({"dataset": {"type": "box", "dims": [4, 3, 2]},
        "tool": {"side": "x+", "stiffness": 500, "motion": "hand.csv"}})";
    EXPECT_LT(parse_scene(stiff, file, small).problem.time_step, 0.1);
    std::string other = stiff;
    other.replace(other.find("hand"), 4, "other");
    EXPECT_EQ(refused([&] { (void)parse_scene(other, file, small); }), "tool.motion: \"other.csv\"");
}

TEST(Scene, EditsPlayBetweenTheirSteps) {
    const Scene scene = box_with(R"("gravity": [0, 0.01, -0.02], "edits": [
        {"step": 0, "cut": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}}},
        {"step": 7, "suture": {"pairs": [[[0, 0, 0], [3, 0, 0]]]}}])");
    const auto backend = BackendSpec::parse("cpu_reference").make();
    Problem edited = scene.problem;
    backend->upload(scene.problem, scene.state);
    SpringEditor editor(edited);
    const SpringEdit first = editor.make(scene.edits[0].edit);
    backend->edit(edited, first);
    backend->step(7);
    const SpringEdit second = editor.make(scene.edits[1].edit);
    backend->edit(edited, second);
    backend->step(3);
    const State by_hand = backend->download();

    SceneRunner runner(scene);
    EXPECT_EQ(runner.edits_within(7), 1);
    EXPECT_EQ(runner.edits_within(8), 2);
    for (int time = 0; time < 2; ++time) {
        runner.rewind(*backend);
        runner.run(*backend, 4);
        runner.run(*backend, 6);
        EXPECT_EQ(backend->download().displacement, by_hand.displacement);
    }
    // A backend that cannot follow the edits says so before the run.
    const auto implicit = BackendSpec::parse("cpu_parallel").make();
    EXPECT_EQ(runner.unsupported(*implicit),
              "some springs are not those of the lattice, which needs neighbour lists "
              "(edit after step 7)");
}

// Remembers the uploaded problem, as the contract lets a backend do, and its springs.
class Remembering final : public Backend {
public:
    Capabilities capabilities() const override { return {}; }
    void upload(const Problem& problem, const State&) override {
        ++uploads;
        uploaded_ = &problem;
        mask_ = problem.lattice.mask;
        springs_ = problem.springs.size();
    }
    void edit(const Problem&, const SpringEdit&) override {}
    bool keep_start() override { return true; }
    void step(int) override {}
    void synchronize() override {}
    State download() override { return {}; }
    int uploads = 0;
    bool has_what_was_uploaded() const {
        return uploaded_->lattice.mask == mask_ && uploaded_->springs.size() == springs_;
    }

private:
    void mark(Mark) override {}
    double seconds_between_marks() const override { return 0; }

    const Problem* uploaded_ = nullptr;
    std::vector<std::uint32_t> mask_;
    std::size_t springs_ = 0;
};

TEST(Scene, EditsThatAreMadeWhenTheyAreDueAreThoseThatWerePrepared) {
    // Edits of 700 KiB each, so that the last ones exceed what is prepared in advance.
    const Scene scene =
        parse_scene(R"({"dataset": {"type": "box", "dims": [4, 90, 90]}, "gravity": [0, 0.01, 0],
        "edits": [
        {"step": 0, "cut": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}}, "repeat": {"times": 5, "every": 2}},
        {"step": 1, "suture": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}, "within": 1.5},
         "repeat": {"times": 5, "every": 2}}]})",
                    "scene", {100000, 100000});
    ASSERT_EQ(scene.edits.size(), 10u);
    SceneRunner runner(scene);
    Remembering backend;
    for (int time = 0; time < 2; ++time) {
        Problem edited = scene.problem;
        SpringEditor editor(edited);
        std::size_t next = 0, bytes = 0;
        runner.rewind(backend);
        runner.run(backend, 10, [&](const Problem& now, const SpringEdit& edit) {
            EXPECT_EQ(edit, editor.make(scene.edits[next++].edit));
            EXPECT_EQ(now.lattice.mask, edited.lattice.mask);
            bytes += edit.listed.size() * sizeof(ListedSpring);
        });
        EXPECT_EQ(next, 10u);
        EXPECT_GT(bytes, SceneRunner::max_prepared_bytes);
    }
}

TEST(Scene, EditsLeaveTheUploadedProblemAsItWas) {
    const Scene scene = box_with(R"("edits": [
        {"step": 2, "cut": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}}},
        {"step": 7, "suture": {"pairs": [[[0, 0, 0], [3, 0, 0]]]}}])");
    const auto keeps = [&](SceneRunner& runner, int steps) {
        Remembering backend;
        runner.rewind(backend);
        runner.run(backend, steps);
        return backend.has_what_was_uploaded();
    };
    SceneRunner runner(scene);
    EXPECT_TRUE(keeps(runner, 10));
    // A run that starts later has the first edit in its upload.
    runner.start_from(4, scene.state);
    EXPECT_TRUE(keeps(runner, 6));
    EXPECT_EQ(runner.problem().springs.size(), 1u);
}

TEST(Scene, StartsAgainWithoutAnUploadWhereItsEditsHaveCancelled) {
    const Scene scene = box_with(R"("edits": [
        {"step": 2, "cut": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}}},
        {"step": 7, "suture": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}, "within": 1.5}}])");
    SceneRunner runner(scene);
    Remembering backend;
    runner.rewind(backend);
    runner.keep_start(backend);
    const auto uploads_after = [&](int steps) {
        backend.uploads = 0;
        runner.run(backend, steps);
        runner.rewind(backend);
        return backend.uploads;
    };
    EXPECT_EQ(uploads_after(2), 0);
    EXPECT_EQ(uploads_after(10), 0);
    EXPECT_EQ(uploads_after(10), 0);
    EXPECT_EQ(uploads_after(5), 1) << "it is cut";
    EXPECT_EQ(uploads_after(10), 0) << "what was uploaded is kept as well";
}

// Backends skip a term whose vector is empty.
TEST(Scene, WhatASceneDoesNotNeedIsAbsent) {
    const Scene scene = parse(R"({"dataset": {"type": "box", "dims": [4, 3, 2]}})");
    const Problem& problem = scene.problem;
    EXPECT_TRUE(problem.material.empty() && problem.pinned.empty() && problem.load.empty() &&
                problem.springs.empty());
    EXPECT_FALSE(problem.has_gravity());
    EXPECT_EQ(problem.damping, 0);
    EXPECT_EQ(problem.group_bits, FACE_BITS | EDGE_BITS);
    EXPECT_EQ(problem.time_step, 0.8 * scene.stable_time_step);
    EXPECT_TRUE(scene.state.displacement.empty());
    EXPECT_TRUE(scene.state.increment.empty());
    EXPECT_TRUE(box_with(R"("pinned": [], "loads": [], "initial": {})").problem.load.empty());
}

TEST(Scene, PhysicalParameters) {
    const Scene scene = box_with(R"("mass": 2, "stiffness": 3, "damping": 0.5, "gravity": [1, 2, 3],
        "spring_groups": ["corner", "face"], "spacing": [1, 2, 3], "time_step": 0.125)");
    EXPECT_EQ(scene.problem.materials.size(), 1u);
    EXPECT_EQ(scene.problem.materials[0].mass, 2);
    EXPECT_EQ(scene.problem.group_stiffness, (std::array<double, 3>{3, 3, 3}));
    EXPECT_EQ(scene.problem.damping, 0.5);
    EXPECT_EQ(scene.problem.gravity, glm::dvec3(1, 2, 3));
    EXPECT_EQ(scene.problem.group_bits, FACE_BITS | CORNER_BITS);
    EXPECT_EQ(scene.problem.rest_position.back(), glm::dvec3(3, 4, 3));
    EXPECT_EQ(scene.problem.rest_length[1], 1);
    EXPECT_DOUBLE_EQ(scene.problem.rest_length[19], std::sqrt(14.0));
    EXPECT_EQ(scene.problem.time_step, 0.125);
    EXPECT_EQ(scene.stable_time_step, stable_time_step(scene.problem));
    EXPECT_EQ(box_with(R"("spacing": 0.5)").problem.lattice.spacing, glm::dvec3(0.5));
    const Scene groups =
        box_with(R"("spring_groups": ["edge", "face"], "stiffness": {"face": 2, "edge": 0.5})");
    EXPECT_EQ(groups.problem.group_stiffness, (std::array<double, 3>{2, 0.5, 1}));
    EXPECT_EQ(groups.problem.time_step, 0.8 * stable_time_step(groups.problem));
}

TEST(Scene, Regions) {
    const auto pinned = [](const std::string& region) {
        return pinned_particles(box_with("\"time_step\": 1, \"pinned\": " + region).problem);
    };
    using List = std::vector<std::size_t>;
    EXPECT_EQ(pinned(R"({"side": "x-"})"), (List{0, 4, 8, 12, 16, 20}));
    EXPECT_EQ(pinned(R"({"side": "x+", "slices": 2})"), (List{2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23}));
    EXPECT_EQ(pinned(R"({"side": "y+"})"), (List{8, 9, 10, 11, 20, 21, 22, 23}));
    EXPECT_EQ(pinned(R"({"side": "z-", "slices": 99})").size(), 24u);
    EXPECT_EQ(pinned(R"({"side": "z+", "fraction": 0.01})").size(), 12u);
    EXPECT_EQ(pinned(R"({"side": "x-", "fraction": 0.5})").size(), 12u);
    // Rounded to the nearest whole slice, with half a slice rounded up: 1.48, 1.5 and 2.48 of 4.
    EXPECT_EQ(pinned(R"({"side": "x-", "fraction": 0.37})").size(), 6u);
    EXPECT_EQ(pinned(R"({"side": "x-", "fraction": 0.375})").size(), 12u);
    EXPECT_EQ(pinned(R"({"side": "x-", "fraction": 0.62})").size(), 12u);
    EXPECT_EQ(pinned(R"({"from": [1, 0, 1], "to": [2, 1, 1]})"), (List{13, 14, 17, 18}));
    EXPECT_EQ(pinned(R"([{"voxel": [0, 0, 0]}, {"voxel": [3, 2, 1]}, {"voxel": [0, 0, 0]}])"), (List{0, 23}));
    const Scene scene = box_with(R"("pinned": {"voxel": [1, 0, 0]})");
    EXPECT_NE(scene.problem.lattice.mask[1] & PINNED_BIT, 0u);
    EXPECT_EQ(scene.problem.lattice.mask[2] & PINNED_BIT, 0u);
}

TEST(Scene, SidesAreCountedFromTheFirstActiveSlice) {
    const Scene heart = load_scene("heart");
    for (const std::size_t i : pinned_particles(heart.problem)) {
        // Active from x = 1 to 55; 0.35 of 55 slices is 19.
        EXPECT_LE(heart.problem.rest_position[i].x, 19);
    }
}

TEST(Scene, LoadsAddUp) {
    const Scene scene = box_with(R"("loads": [{"voxel": [1, 0, 0], "force": [1, 0, 0]},
        {"side": "z-", "force": [0, 2, 0]}])");
    ASSERT_EQ(scene.problem.load.size(), 24u);
    EXPECT_EQ(scene.problem.load[0], glm::dvec3(0, 2, 0));
    EXPECT_EQ(scene.problem.load[1], glm::dvec3(1, 2, 0));
    EXPECT_EQ(scene.problem.load[12], glm::dvec3(0));
}

TEST(Scene, InitialState) {
    const Scene scene = box_with(R"("pinned": {"voxel": [0, 0, 0]}, "time_step": 0.5,
        "initial": {"displacement": [1, 2, 3], "velocity": [4, 0, -2]})");
    EXPECT_EQ(scene.state.displacement[0], glm::dvec3(0));
    EXPECT_EQ(scene.state.increment[0], glm::dvec3(0));
    EXPECT_EQ(scene.state.displacement[1], glm::dvec3(1, 2, 3));
    EXPECT_EQ(scene.state.increment[1], glm::dvec3(2, 0, -1));
}

TEST(Scene, InitialStateOfARegion) {
    const Scene scene = box_with(R"("pinned": {"voxel": [0, 0, 0]}, "time_step": 0.5, "initial": {
        "displacement": {"vector": [1, 2, 3], "from": [0, 0, 0], "to": [1, 0, 9]},
        "velocity": {"vector": [4, 0, -2], "side": "x+", "slices": 2}})");
    for (std::size_t i = 0; i < 24; ++i) {
        const glm::dvec3 at = scene.problem.rest_position[i];
        const bool displaced = at.x <= 1 && at.y == 0 && i != 0;
        EXPECT_EQ(scene.state.displacement[i], displaced ? glm::dvec3(1, 2, 3) : glm::dvec3(0)) << i;
        EXPECT_EQ(scene.state.increment[i], at.x >= 2 ? glm::dvec3(2, 0, -1) : glm::dvec3(0)) << i;
    }
    // Without a region the short form applies; a region does not change the numbers.
    EXPECT_EQ(box_with(R"("initial": {"velocity": {"vector": [4, 0, -2]}})").state.increment,
              box_with(R"("initial": {"velocity": [4, 0, -2]})").state.increment);
    const auto random = [](const std::string& region) {
        return box_with(R"("initial": {"displacement": {"random": 0.25, "seed": 5)" + region + "}}")
            .state.displacement;
    };
    const auto everywhere = random(""), above = random(R"(, "side": "z+")");
    for (std::size_t i = 0; i < 24; ++i) EXPECT_EQ(above[i], i < 12 ? glm::dvec3(0) : everywhere[i]) << i;
}

TEST(Scene, RandomStatesRepeat) {
    const auto random = [](const std::string& seed) {
        return box_with(R"("initial": {"displacement": {"random": 0.25, "seed": )" + seed + "}}")
            .state.displacement;
    };
    EXPECT_EQ(random("5"), random("5"));
    EXPECT_NE(random("5"), random("6"));
    double largest = 0;
    double smallest = 0;
    for (const glm::dvec3& u : random("5")) {
        largest = std::max({largest, u.x, u.y, u.z});
        smallest = std::min({smallest, u.x, u.y, u.z});
    }
    EXPECT_LE(largest, 0.25);
    EXPECT_GE(smallest, -0.25);
    EXPECT_GT(largest - smallest, 0.4);
    // The first output of std::mt19937_64 for its default seed is 14514284786278117030 (C++ standard:
    // the 10000th is 9981545732273789042; this is its first), so these bits hold on every machine.
    EXPECT_EQ(random("5489")[0].x, 0.25 * (std::ldexp(double(14514284786278117030u >> 11), -52) - 1));
}

TEST(Scene, VolumesByThresholdAndLabels) {
    const TemporaryFolder folder;
    write_volume(folder, "dimension: 3\nsizes: 2 2 2\nspacings: 1 2 3", std::string{0, 1, 1, 0, 2, 2, 0, 2});
    const auto scene = [&](const std::string& dataset, const std::string& keys) {
        return volume_scene(folder, "v.nrrd", dataset, keys);
    };
    const Scene threshold = scene("", "");
    EXPECT_EQ(threshold.name, "s.json");
    EXPECT_EQ(threshold.problem.lattice.voxel, (std::vector<std::uint32_t>{1, 2, 4, 5, 7}));
    EXPECT_EQ(threshold.problem.lattice.spacing, glm::dvec3(1, 2, 3));
    EXPECT_TRUE(threshold.problem.material.empty());
    EXPECT_EQ(scene(R"(, "threshold": 1.5)", "").problem.lattice.voxel,
              (std::vector<std::uint32_t>{4, 5, 7}));
    EXPECT_EQ(scene(R"(, "labels": [1])", R"(, "spacing": 7)").problem.lattice.spacing, glm::dvec3(7));

    const Scene labelled = scene("", R"(, "mass": {"2": 20, "1": 10}, "stiffness": {"1": 3, "2": 4})");
    EXPECT_EQ(labelled.problem.material, (std::vector<std::uint8_t>{0, 0, 1, 1, 1}));
    ASSERT_EQ(labelled.problem.materials.size(), 2u);
    EXPECT_EQ(labelled.problem.materials[0].mass, 10);
    EXPECT_EQ(labelled.problem.materials[0].stiffness, 3);
    EXPECT_EQ(labelled.problem.materials[1].mass, 20);
    EXPECT_EQ(labelled.problem.materials[1].stiffness, 4);
    const Scene one_of_them = scene(R"(, "labels": [2])", R"(, "mass": {"2": 20})");
    EXPECT_EQ(one_of_them.problem.particle_count(), 3u);
    EXPECT_EQ(one_of_them.problem.materials[0].mass, 20);
    // Equal values make one material.
    EXPECT_FALSE(scene("", R"(, "mass": {"1": 2, "2": 2})").problem.has_materials());

    const std::array<std::string, 3> cases[] = {
        {"", R"(, "mass": {"1": 2})", R"(mass: {"1":2})"},
        {"", R"(, "mass": {"1": 2, "2": 2, "3": 2})", R"(mass: {"1":2,"2":2,"3":2})"},
        {"", R"(, "mass": {"1": 2, "2": 3}, "stiffness": {"face": 1, "edge": 1})",
         R"(stiffness: {"edge":1,"face":1})"},
        {R"(, "threshold": 2)", "", "threshold: 2"},
        {R"(, "labels": [3])", "", "labels: 3"},
    };
    for (const auto& [dataset, keys, expected] : cases)
        EXPECT_EQ(refused([&, &d = dataset, &k = keys] { scene(d, k); }), expected);
}

/// "wall" and "valve" in one layer of a 3D Slicer file, x to the left, y to the posterior, z to the superior.
std::string segments_of_a_body() {
    return nrrd_file(
        "type: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 2 3\n"
        "space directions: (1,0,0) (0,1.6,1.2) (0,-1.2,1.6)\nspace origin: (5,6,7)\nencoding: raw\n"
        "Segment0_ID:=Segment_1\nSegment0_Name:=wall\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n"
        "Segment1_ID:=Segment_2\nSegment1_Name:=valve\nSegment1_LabelValue:=2\nSegment1_Layer:=0\n",
        std::string{1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 0, 0});
}

TEST(Scene, SegmentsAreNamed) {
    const TemporaryFolder folder;
    folder.write("v.seg.nrrd", segments_of_a_body());
    const auto scene = [&](const std::string& dataset, const std::string& keys) {
        return volume_scene(folder, "v.seg.nrrd", dataset, keys);
    };
    EXPECT_EQ(scene("", "").problem.particle_count(), 10u);
    EXPECT_EQ(scene(R"(, "labels": ["valve"])", "").problem.particle_count(), 4u);
    const Scene by_name =
        scene("", R"(, "mass": {"wall": 1, "Segment_2": 3}, "stiffness": {"1": 2, "valve": 4})");
    ASSERT_EQ(by_name.problem.materials.size(), 2u);
    EXPECT_EQ(by_name.problem.materials[1].mass, 3);
    EXPECT_EQ(by_name.problem.materials[1].stiffness, 4);
    ASSERT_TRUE(by_name.volume);
    const std::vector<std::pair<std::string, std::uint64_t>> counts = {{"wall", 6}, {"valve", 4}};
    EXPECT_EQ(by_name.volume->labels, counts);
    EXPECT_THAT(refusal([&] { scene("", R"(, "mass": {"wall": 1})"); }),
                HasSubstr("expected a value for each of the labels wall, valve"));
    EXPECT_THAT(refusal([&] { scene("", R"(, "mass": {"wall": 1, "1": 1, "valve": 2})"); }),
                HasSubstr("expected one value for wall, not two by different names"));
}

TEST(Scene, SidesOfTheBodyAreThoseOfItsFile) {
    const TemporaryFolder folder;
    folder.write("v.seg.nrrd", segments_of_a_body());
    const auto scene = [&](const std::string& keys) {
        return volume_scene(folder, "v.seg.nrrd", "", ", " + keys);
    };
    // z is 37 degrees off the superior direction, and the nearest axis to it.
    const Scene pinned = scene(R"("pinned": {"side": "inferior"})");
    const Scene by_axis = scene(R"("pinned": {"side": "z-"})");
    EXPECT_EQ(pinned.problem.pinned, by_axis.problem.pinned);
    EXPECT_THAT(pinned.notes,
                ElementsAre("inferior is taken for z-, which is 37 degrees off", HasSubstr("nothing moves")));
    EXPECT_THAT(by_axis.notes, ElementsAre(HasSubstr("nothing moves")));
    EXPECT_EQ(scene(R"("pinned": {"side": "right"})").problem.pinned,
              scene(R"("pinned": {"side": "x-"})").problem.pinned);
    // Gravity takes the exact direction.
    const glm::dvec3 gravity = scene(R"("gravity": {"toward": "inferior", "strength": 10})").problem.gravity;
    EXPECT_LT(glm::distance(gravity, glm::dvec3(0, -6, -8)), 1e-13);
    EXPECT_EQ(scene(R"("gravity": {"toward": "y+", "strength": 10})").problem.gravity, glm::dvec3(0, 10, 0));
}

TEST(Scene, AFrameAndASpacingAreChosenBeforeTheFileIsJudged) {
    const TemporaryFolder folder;
    write_volume(folder, "dimension: 4\nsizes: 2 2 2 2\nkinds: space space space time\nspacings: 0 1 1 1",
                 std::string(8, '\1') + std::string{0, 0, 0, 0, 0, 0, 1, 1});
    const Scene scene = volume_scene(folder, "v.nrrd", R"(, "frame": 1)", R"(, "spacing": 3)");
    EXPECT_EQ(scene.problem.particle_count(), 2u);
    EXPECT_EQ(scene.problem.lattice.spacing, glm::dvec3(3));
    EXPECT_EQ(refused([&] { volume_scene(folder, "v.nrrd", R"(, "frame": 1)"); }), "spacings: 0 1 1 1");
    VolumeOptions options;
    options.frame = 0;
    options.spacing = glm::dvec3(3);
    EXPECT_EQ(load_scene((folder.path() / "v.nrrd").string(), options, small).problem.particle_count(), 8u);
}

TEST(Scene, AVolumeByItselfHasTheParametersOfTheHeart) {
    const TemporaryFolder folder;
    const std::string data(4 * 5 * 6, '\3');
    const std::string file = folder.write(
        "wall.seg.nii.gz", gzipped(nifti_file(nifti_header({4, 5, 6}, 2, {0.5F, 0.5F, 2}), data)));
    const Scene scene = load_scene(file, small);
    const Scene heart = load_scene("heart");
    EXPECT_EQ(scene.name, "wall.seg.nii.gz");
    EXPECT_EQ(scene.problem.particle_count(), 120u);
    EXPECT_EQ(scene.problem.lattice.spacing, glm::dvec3(0.5, 0.5, 2));
    EXPECT_EQ(scene.problem.gravity, heart.problem.gravity * glm::dvec3(0.5, 0.5, 2));
    EXPECT_EQ(scene.problem.damping, heart.problem.damping);
    EXPECT_EQ(pinned_particles(scene.problem).size(), 30u);
    const SceneSizeLimits few_voxels{100, 100}, few_particles{200, 100};
    EXPECT_EQ(
        refusal([&] { load_scene(file, few_voxels); }),
        file + ": dim: 4 x 5 x 6 is not accepted; expected at most 100 voxels on this machine, not 120");
    EXPECT_EQ(refused([&] { load_scene(file, few_particles); }), "dataset: 120 active voxels");
}

TEST(Scene, PartsOfABodyAreNamedAndLeftOut) {
    const TemporaryFolder folder;
    // Two slices of 6 x 3: a block of 12, a row of three and one voxel alone.
    std::string data;
    for (const char c : std::string("110001110001110101110000110000110000")) data.push_back(char(c - '0'));
    write_volume(folder, "dimension: 3\nsizes: 6 3 2\nspacings: 1 1 1", data);
    const std::string gravity = R"(, "gravity": [0, 0, -1e-3])", pinned = R"(, "pinned": {"side": "x-"})";
    const auto loaded = [&](const std::string& dataset, const std::string& groups = R"("face")") {
        return volume_scene(folder, "v.nrrd", dataset,
                            gravity + pinned + R"(, "spring_groups": [)" + groups + "]");
    };
    const Scene all = loaded("");
    EXPECT_THAT(all.notes, ElementsAre(AllOf(
                               StartsWith("the body has 3 parts: 12, 3 and 1 particles; 4 particles are in "
                                          "parts that nothing pins, and fall"),
                               HasSubstr("--parts largest"))));
    EXPECT_THAT(parts_of(all.problem).loose(), ElementsAre(2, 5, 8, 9));
    EXPECT_THAT(parts_of(all.problem).sizes, ElementsAre(12, 3, 1));
    const Scene largest = loaded(R"(, "parts": "largest")");
    EXPECT_EQ(largest.problem.particle_count(), 12u);
    EXPECT_THAT(largest.notes, ElementsAre("4 particles in 2 of 3 parts are left out (parts: largest)"));
    const Scene some = loaded(R"(, "parts": 3)");
    EXPECT_EQ(some.problem.particle_count(), 15u);
    EXPECT_THAT(some.notes, ElementsAre("1 particle in 1 of 3 parts is left out (parts: 3)",
                                        HasSubstr("2 parts: 12 and 3 particles; 3 particles are in")));
    EXPECT_EQ(refused([&] { loaded(R"(, "parts": 13)"); }), "dataset.parts: 13");
    // The spring groups determine which voxels are connected.
    EXPECT_THAT(loaded("", R"("face", "edge", "corner")").notes.at(0), HasSubstr("3 parts"));
    // If no particle is pinned, no part counts as loose.
    const Scene free = volume_scene(folder, "v.nrrd", "", gravity + R"(, "spring_groups": ["face"])");
    EXPECT_THAT(free.notes, ElementsAre(StartsWith("the body has 3 parts: 12, 3 and 1 particles;"),
                                        HasSubstr("fall freely")));
    EXPECT_TRUE(parts_of(free.problem).loose().empty());
    VolumeOptions options;
    options.gravity = glm::dvec3(0);
    options.parts = PartsToKeep{};
    EXPECT_EQ(load_scene((folder.path() / "v.nrrd").string(), options, small).problem.particle_count(), 12u);
}

TEST(Scene, VoxelsThatShareACornerAreOnePartIfParticlesAreThere) {
    const TemporaryFolder folder;
    // Two voxels that share a face, a third that shares an edge with the second, and a fourth alone.
    std::string data;
    for (const char c : std::string("11000"
                                    "00101"
                                    "00000"
                                    "00000"))
        data.push_back(char(c - '0'));
    write_volume(folder, "dimension: 3\nsizes: 5 2 2\nspacings: 1 1 1", data);
    const Scene scene = volume_scene(folder, "v.nrrd", R"(, "parts": "largest")",
                                     R"(, "pinned": {"side": "x-"}, "particles": "corners")");
    EXPECT_EQ(scene.problem.particle_count(), 18u);
    EXPECT_THAT(scene.notes, Contains("1 voxel in 1 of 2 parts is left out (parts: largest)"));
}

// With particles at corners, springs of the surface have a part of the stiffness of others. A suture gives
// lattice neighbours a whole spring in their place.
TEST(Scene, TheTimeStepAllowsForSuturesThatAreStifferThanWhatWasCut) {
    const Scene scene =
        parse(R"({"dataset": {"type": "box", "dims": [4, 4, 4]}, "particles": "corners", "edits": [
        {"step": 1, "cut": {"plane": {"point": [0, 0, 1.5], "normal": [0, 0, 1]}}},
        {"step": 2, "suture": {"plane": {"point": [0, 0, 1.5], "normal": [0, 0, 1]}, "within": 1.5}}]})");
    Problem edited = scene.problem;
    for (const ScheduledEdit& scheduled : scene.edits) apply(edited, scheduled.edit);
    EXPECT_LT(stable_time_step(edited), stable_time_step(scene.problem));
    EXPECT_LE(scene.stable_time_step, stable_time_step(edited));
}

// With particles at corners, springs of the labels after the first are not those of the lattice.
TEST(Scene, ANoteNamesTheStiffestSpringOfAllLabels) {
    const TemporaryFolder folder;
    write_volume(folder, "dimension: 3\nsizes: 4 4 4", std::string(32, '\1') + std::string(32, '\2'));
    for (const std::string particles : {"centres", "corners"}) {
        const Scene scene = volume_scene(folder, "v.nrrd", R"(, "labels": [1, 2])",
                                         R"(, "unit": "mm", "young": {"1": 1000, "2": 1e5}, "density": 1000,
                                             "particles": ")" +
                                             particles + "\"");
        EXPECT_THAT(scene.notes, Contains(HasSubstr("springs have up to 40 N/m"))) << particles;
    }
}

TEST(Parts, OfABoxAreFoundHoweverItIsCut) {
    Problem box = make_lattice_problem(solid({5, 4, 3}), FACE_BITS | EDGE_BITS);
    EXPECT_EQ(parts_of(box).sizes, (std::vector<std::size_t>{60}));
    EXPECT_EQ(parts_of(box).is_held, (std::vector<std::uint8_t>{0}));
    pin_base(box);
    EXPECT_EQ(parts_of(box).is_held, (std::vector<std::uint8_t>{1}));
    (void)SpringEditor(box).cut(Plane{{0, 0, 0.5}, {0, 0, 1}});
    EXPECT_EQ(parts_of(box).sizes, (std::vector<std::size_t>{40, 20}));
    EXPECT_EQ(parts_of(box).is_held, (std::vector<std::uint8_t>{0, 1}));
    EXPECT_EQ(parts_of(box).loose().size(), 40u);
    // Edge springs alone join every second voxel.
    EXPECT_EQ(parts_of(make_lattice_problem(solid({4, 4, 4}), EDGE_BITS)).sizes,
              (std::vector<std::size_t>{32, 32}));
}

TEST(Parts, AreDescribedShortly) {
    EXPECT_EQ(with_commas(999), "999");
    EXPECT_EQ(with_commas(10437), "10,437");
    EXPECT_EQ(with_commas(1234567), "1,234,567");
    BodyParts parts{.sizes = {10437, 9, 5}, .part = {}, .is_held = {1, 0, 0}};
    parts.part.insert(parts.part.end(), 10437, 0);
    parts.part.insert(parts.part.end(), 9, 1);
    parts.part.insert(parts.part.end(), 5, 2);
    EXPECT_EQ(describe(parts, true),
              "the body has 3 parts: 10,437, 9 and 5 particles; 14 particles are in parts that nothing pins, "
              "and fall");
    EXPECT_EQ(describe(parts, false),
              "the body has 3 parts: 10,437, 9 and 5 particles; 14 particles are in parts that nothing pins");
    const BodyParts islet{.sizes = {2, 1}, .part = {0, 0, 1}, .is_held = {1, 0}};
    EXPECT_THAT(describe(islet, true), EndsWith("; 1 particle is in parts that nothing pins, and falls"));
    EXPECT_THAT(describe(islet, false), EndsWith("; 1 particle is in parts that nothing pins"));
    EXPECT_EQ(describe({.sizes = {40, 4, 3, 2, 1, 1}, .part = {}, .is_held = {1, 1, 1, 1, 1, 1}}, true),
              "the body has 6 parts: 40, 4 and 3 particles, and 3 of at most 2");
    EXPECT_EQ(describe({.sizes = {40}, .part = {}, .is_held = {0}}, true), "");
}

// The heart is pinned at one side of x, where a rod along z has only one slice.
TEST(Scene, ARodByItselfIsPinnedAtItsEnd) {
    const TemporaryFolder folder;
    const auto rod = [&](glm::ivec3 dims) {
        const std::string data(std::size_t(dims.x * dims.y * dims.z), '\1');
        return load_scene(folder.write("rod.nii", nifti_file(nifti_header(dims, 2), data)), small);
    };
    for (const glm::ivec3 dims : {glm::ivec3(1, 1, 97), glm::ivec3(1, 97, 1), glm::ivec3(97, 1, 1)}) {
        const Scene scene = rod(dims);
        EXPECT_EQ(count_springs(scene.problem).total(), 96u);
        // 0.35 of 97 slices, from the lower end.
        const std::vector<std::size_t> pinned = pinned_particles(scene.problem);
        EXPECT_EQ(pinned.size(), 34u);
        EXPECT_EQ(pinned.back(), 33u);
        EXPECT_EQ(scene.problem.time_step, 0.5 * scene.stable_time_step);
    }
    const glm::ivec3 one(1);
    EXPECT_THAT(refusal([&] { rod(one); }),
                HasSubstr(R"(time_step: {"fraction_of_stable":0.5} is not accepted; )"
                          "expected an absolute time step, as a number in units of time: every particle is"));
}

TEST(Scene, AVolumeByItselfSagsByAsManyVoxelsInAnyUnit) {
    const TemporaryFolder folder;
    const auto bar = [&](glm::vec3 spacing, const VolumeOptions& options = {}) {
        const std::string data(12 * 3 * 4, '\1');
        return load_scene(folder.write("bar.nii", nifti_file(nifti_header({12, 3, 4}, 2, spacing), data)),
                          options, small);
    };
    const auto sag_in_voxels = [](const Scene& scene) {
        std::vector<glm::dvec3> sag = stepped("cpu_reference", scene.problem, scene.state, 200).displacement;
        for (glm::dvec3& u : sag) u /= scene.problem.lattice.spacing;
        return sag;
    };
    const Scene unit = bar({1, 1, 1});
    EXPECT_EQ(unit.problem.gravity, load_scene("heart").problem.gravity);
    // The user hears of all that was chosen: gravity, which has an option, apart from the rest.
    ASSERT_EQ(unit.notes.size(), 2u);
    EXPECT_THAT(unit.notes[0],
                AllOf(HasSubstr("above 0"), HasSubstr("pinned from x 0 to 3"),
                      HasSubstr("damping 0.00115 per step"), HasSubstr("stiffness 1, mass 1"),
                      HasSubstr("face and edge springs"), HasSubstr("0.5 of the stable time step")));
    EXPECT_THAT(unit.notes[1], StartsWith("gravity is (0.0008, 0, -0.002)"));
    const std::vector<glm::dvec3> expected = sag_in_voxels(unit);
    EXPECT_GT(glm::length(expected.back()), 0.02);
    for (const float side : {0.035F, 3.5e-5F, 2.0F, 700.0F}) {
        const std::vector<glm::dvec3> sag = sag_in_voxels(bar({side, side, side}));
        for (std::size_t i = 0; i < sag.size(); ++i)
            EXPECT_LT(glm::distance(sag[i], expected[i]), 1e-9) << side;
    }
    // If voxels are no cubes, each component of gravity stays the same number of voxels of its axis.
    EXPECT_EQ(bar({0.5F, 0.5F, 2}).problem.gravity, unit.problem.gravity * glm::dvec3(0.5, 0.5, 2));
    VolumeOptions upwards;
    upwards.gravity = glm::dvec3(0, 1, 0);
    const Scene chosen = bar({0.5F, 0.5F, 2}, upwards);
    EXPECT_EQ(chosen.problem.gravity, glm::dvec3(0, 1, 0));
    EXPECT_EQ(chosen.notes.size(), 1u);
    VolumeOptions by_threshold, by_label;
    by_threshold.threshold = 0;
    by_label.labels = std::vector<std::string>{"1"};
    for (const VolumeOptions& options : {by_threshold, by_label})
        EXPECT_THAT(bar({1, 1, 1}, options).notes[0], Not(HasSubstr("above 0")));
}

TEST(Scene, AVolumeThatFallsOrThatNothingMovesIsSaid) {
    const TemporaryFolder folder;
    write_volume(folder, "dimension: 3\nsizes: 2 2 2\nspacings: 1 1 1", std::string(8, '\1'));
    const auto notes = [&](const std::string& keys) {
        return volume_scene(folder, "v.nrrd", "", ", " + keys).notes;
    };
    const std::string pinned = R"("pinned": {"side": "z-"})", gravity = R"("gravity": [0, 0, -1])";
    EXPECT_THAT(notes(gravity), ElementsAre(HasSubstr("fall freely")));
    EXPECT_THAT(notes(pinned), ElementsAre(HasSubstr("nothing moves")));
    EXPECT_THAT(notes(pinned + ", " + gravity), IsEmpty());
    EXPECT_THAT(notes(R"("initial": {"velocity": [0.1, 0, 0]})"), IsEmpty());
    EXPECT_THAT(notes(R"("loads": [{"voxel": [0, 0, 0], "force": [1, 0, 0]}])"), IsEmpty());
    EXPECT_THAT(box_with(pinned).notes, IsEmpty());
}

TEST(Scene, WhereNothingOscillatesItIsSaidWhy) {
    const auto refused = [](const std::string& keys) {
        const std::string message = refusal([&] { box_with(keys); });
        return message.substr(message.rfind("time: "));
    };
    const std::string so = ", so that there is no limit to take a fraction of";
    EXPECT_EQ(refused(R"("pinned": {"side": "z-", "slices": 2})"), "time: every particle is pinned" + so);
    EXPECT_EQ(refusal([] { parse(R"({"dataset": {"type": "box", "dims": [1, 1, 1]}})"); }),
              "scene: time_step is missing; expected an absolute time step, as a number in units of time: "
              "there are no "
              "springs" +
                  so);
    // Two particles held and one that falls past them.
    const TemporaryFolder folder;
    write_volume(folder, "dimension: 3\nsizes: 4 1 1", std::string("\1\1\0\1", 4));
    const std::string text =
        R"({"dataset": {"type": "volume", "file": "v.nrrd"}, "pinned": {"side": "x-", "slices": 2}})";
    const std::string message = refusal([&] { load_scene(folder.write("s.json", text), small); });
    EXPECT_EQ(message.substr(message.rfind("time: ")), "time: no particle that may move has a spring" + so);
}

TEST(Scene, SceneFilesCanBeResized) {
    const TemporaryFolder folder;
    const std::string file =
        folder.write("my@2.json", R"({"dataset": {"type": "box", "dims": [2, 2, 2]}, "description": "d"})");
    EXPECT_EQ(load_scene(file).name, "my@2.json");
    EXPECT_EQ(load_scene(file).source, file);
    EXPECT_EQ(load_scene(file + "@3x4x5").name, "my@2.json@3x4x5");
    EXPECT_EQ(load_scene(file + "@3x4x5").source, file + "@3x4x5");
    EXPECT_EQ(load_scene(file + "@3x4x5").problem.lattice.dims, glm::ivec3(3, 4, 5));
    EXPECT_EQ(load_scene(file).description, "d");
}

TEST(Scene, BadArgumentsAreRefused) {
    const TemporaryFolder folder;
    const auto refused = [](const std::string& argument) {
        return refusal([&] { load_scene(argument, small); });
    };
    EXPECT_EQ(
        refused("bax"),
        "bax: scene: bax is not accepted; expected a built-in scene (beam, box, free, grasp, heart, "
        "incision, poke, porous, press, "
        "scalpel_1, scalpel_10, scalpel_100), a scene file (.json), a volume file (.nii, .nii.gz, .hdr, "
        ".hdr.gz, .img, .img.gz, .nrrd, .nhdr, .mha or .mhd) or a mesh (.stl, .obj, .ply, .vtk or .msh); "
        "did you mean box?");
    for (const std::string suffix :
         {"@", "@x", "@4x4", "@4x4x4x4", "@-4", "@4.5", "@4x", "@4x4x", "@4 ", "@x4x4x4", "@4xx4"})
        EXPECT_THAT(refused("box" + suffix),
                    EndsWith(": dims: " + suffix + " is not accepted; expected @N or @WxHxD"));
    for (const std::string suffix : {"@99999999", "@99999999999999999999", "@2x1048577x2"})
        EXPECT_THAT(refused("box" + suffix),
                    HasSubstr(suffix + " is not accepted; expected sides from 1 to"));
    const std::string v =
        folder.write("v.json", R"({"dataset": {"type": "volume", "file": "v.nrrd"}})") + "@4";
    const std::string twice = folder.write("twice.json", "{\"dataset\": 1,\n \"dataset\": 2}");
    for (const auto& [argument, expected] :
         std::vector<std::pair<std::string, std::string>>{{"box@0", "dataset.dims: 0 x 0 x 0"},
                                                          {"box@47", "dataset.dims: 47 x 47 x 47"},
                                                          {"box@30", "dataset: 27000 active voxels"},
                                                          {"absent.json", "a missing file"},
                                                          {"absent.nrrd", "a missing file"},
                                                          {v, "dims: @4"},
                                                          {twice, "dataset: a second value"}})
        EXPECT_THAT(refused(argument), StartsWith(argument + ": " + expected + " is not accepted"));
}

// The documents that tests/schema_test.py compares with the published schema.
class Corpus : public ::testing::Test {
protected:
    Corpus() { std::ifstream(VOXSPRING_SCENE_CORPUS) >> corpus_; }
    nlohmann::json corpus_;
};

TEST_F(Corpus, GoodDocumentsAreAccepted) {
    ASSERT_GT(corpus_["accepted"].size(), 5u);
    for (const auto& scene : corpus_["accepted"])
        EXPECT_NO_THROW(read_scene_file(parse_json(scene.dump(), "scene"))) << scene;
}

TEST_F(Corpus, BadDocumentsAndThoseThatDoNotFitTheirVoxelsAreRefusedInOneLine) {
    const auto refuse = [&](const char* list, std::size_t most, const auto& read) {
        ASSERT_GT(corpus_[list].size(), most);
        for (const auto& bad : corpus_[list])
            EXPECT_EQ(refusal([&] { read(bad["scene"].dump()); }), bad["message"].get<std::string>()) << bad;
    };
    refuse("refused", 50, [](const std::string& text) { read_scene_file(parse_json(text, "scene")); });
    refuse("refused_with_voxels", 5, [](const std::string& text) { parse(text); });
}

Problem small_box() { return make_lattice_problem(solid({3, 2, 2}), FACE_BITS); }

/// Two particles on no grid, a spring between them.
Problem pair() {
    Problem problem;
    problem.rest_position = {{0, 0, 0}, {1, 0, 0}};
    problem.springs = {{0, 1, 4.0, 1.0}};
    return problem;
}

TEST(SceneOf, AProblemWithoutATimeStepTakesHalfOfTheStableOne) {
    const Scene scene = scene_of("mine", small_box());
    EXPECT_EQ(scene.name, "mine");
    EXPECT_EQ(scene.stable_time_step, stable_time_step(small_box()));
    EXPECT_EQ(scene.problem.time_step, scene.stable_time_step / 2);
    EXPECT_TRUE(scene.state.displacement.empty());
    EXPECT_TRUE(scene.state.increment.empty());
    Problem problem = small_box();
    problem.time_step = 0.125;
    State state = state_at_rest(problem);
    state.displacement[3] = {0.5, 0, 0};
    const Scene moved = scene_of("mine", problem, state);
    EXPECT_EQ(moved.problem.time_step, 0.125);
    EXPECT_EQ(moved.state.displacement, state.displacement);
    state.increment.clear();
    EXPECT_TRUE(scene_of("mine", problem, state).state.increment.empty());
    // omega^2 = 2 k / m.
    EXPECT_DOUBLE_EQ(scene_of("pair", pair()).stable_time_step, 2 / std::sqrt(8.0));
}

TEST(SceneOf, RefusesWhatBackendsDoNotCheck) {
    const auto expect_refused = [](const std::string& word, const Problem& problem,
                                   const std::string& name = "mine", const State& state = {}) {
        EXPECT_THAT([&] { scene_of(name, problem, state); },
                    ThrowsMessage<std::invalid_argument>(HasSubstr(word)));
    };
    EXPECT_NO_THROW(scene_of("mine", small_box()));
    Problem moved = small_box();
    for (glm::dvec3& position : moved.rest_position) position += glm::dvec3(100.3, -7, 0.1);
    EXPECT_NO_THROW(scene_of("mine", moved));
    for (const char* name : {"", "a/b", "a b"}) expect_refused("name", small_box(), name);
    expect_refused("no particles", {});
    using P = Problem&;
    using Case = std::pair<const char*, void (*)(P)>;
    for (const auto& [word, change] : std::vector<Case>{
             {"material", [](P p) { p.material = {0}; }},
             {"index into materials", [](P p) { p.material.assign(12, 1); }},
             {"pinned", [](P p) { p.pinned = {0}; }},
             {"load", [](P p) { p.load.resize(13); }},
             {"no material", [](P p) { p.materials.clear(); }},
             {"mass", [](P p) { p.materials[0].mass = 0; }},
             {"stiffness", [](P p) { p.materials[0].stiffness = NAN; }},
             {"damping", [](P p) { p.damping = 2; }},
             {"time step", [](P p) { p.time_step = -1; }},
             {"time step", [](P p) { p.time_step = INFINITY; }},
             {"mask", [](P p) { p.lattice.mask.pop_back(); }},
             {"voxel", [](P p) { p.lattice.voxel.pop_back(); }},
             {"ascend", [](P p) { std::swap(p.lattice.voxel[0], p.lattice.voxel[1]); }},
             {"outside", [](P p) { p.lattice.voxel.back() = 12; }},
             {"dims", [](P p) { p.lattice.dims.z = -2; }},
             // The first product of the sides exceeds 64 bits, the second 32 bits.
             {"dims are above", [](P p) { p.lattice.dims = glm::ivec3(1 << 30); }},
             {"dims are above", [](P p) { p.lattice.dims = glm::ivec3(1 << 20); }},
             {"spacing", [](P p) { p.lattice.spacing.y = 0; }},
             {"dims of 0", [](P p) { p.lattice.dims = glm::ivec3(0); }},
             // Masks that would make backends read outside of the body, and values that would spread.
             {"outside of its grid", [](P p) { p.lattice.mask[0] |= 1U; }},
             {"none of the problem's spring groups (group_bits)", [](P p) { p.lattice.mask[0] |= 1U << 7; }},
             {"one of its ends only", [](P p) { p.lattice.mask[0] &= ~2U; }},
             {"active bit", [](P p) { p.lattice.mask[0] &= ~ACTIVE_BIT; }},
             {"pinned bit", [](P p) { p.lattice.mask[0] |= PINNED_BIT; }},
             {"group_bits", [](P p) { p.group_bits |= 1U << 30; }},
             {"no particle",  // the box with a hole, of which the masks around it do not know
              [](P p) {
                  for (auto* list : {&p.lattice.voxel, &p.lattice.mask}) list->erase(list->begin() + 1);
                  p.rest_position.erase(p.rest_position.begin() + 1);
              }},
             {"rest length", [](P p) { p.rest_length[1] = NAN; }},
             {"opposite direction", [](P p) { p.rest_length[0] = 2; }},
             {"group's stiffness", [](P p) { p.group_stiffness[0] = INFINITY; }},
             {"rest position", [](P p) { p.rest_position[2].y = NAN; }},
             {"not that of its voxel", [](P p) { p.rest_position[2].y += 0.1; }},
             {"gravity", [](P p) { p.gravity.z = INFINITY; }},
             {"load", [](P p) { p.load.assign(p.particle_count(), glm::dvec3(NAN)); }},
             {"pinned", [](P p) { p.pinned.assign(p.particle_count(), 2); }},
             {"`held` is not finite",
              [](P p) {
                  take_hold(p, {{0}, {glm::dvec3(NAN)}, 1});
              }},
         }) {
        Problem problem = small_box();
        change(problem);
        expect_refused(word, problem);
    }
    for (const auto& [word, change] : std::vector<Case>{
             {"ends", [](P p) { p.springs[0].second = 2; }},
             {"ends", [](P p) { std::swap(p.springs[0].first, p.springs[0].second); }},
             {"stiffness", [](P p) { p.springs[0].stiffness = 0; }},
             {"rest length", [](P p) { p.springs[0].rest_length = -1; }},
             {"nothing limits it", [](P p) { p.springs.clear(); }},
         }) {
        Problem problem = pair();
        change(problem);
        expect_refused(word, problem);
    }
    State broken = state_at_rest(small_box());
    broken.displacement[1].x = NAN;
    expect_refused("displacement is not finite", small_box(), "mine", broken);
    State state = state_at_rest(small_box());
    state.increment.pop_back();
    expect_refused("increment must have one element", small_box(), "mine", state);
    expect_refused("displacement must have one element", small_box(), "mine", {{{1, 0, 0}}, {}});
}

TEST(SceneOf, ABodyOnNoLatticeIsExportedWithoutVoxels) {
    const Scene scene = scene_of("pair", pair());
    const State state{{{0.5, 0, 0}, {0.5, 0, 0}}, {{0, 0, 0}, {0, 0, 0}}};
    EXPECT_EQ(csv({scene, scene.problem, state, 0, 0, "cpu_reference"}),
              "x,y,z,displacement_x,displacement_y,displacement_z,velocity_x,velocity_y,velocity_z\n"
              "0.5,0,0,0.5,0,0,0,0,0\n1.5,0,0,0.5,0,0,0,0,0\n");
}

}  // namespace
}  // namespace voxspring::testing
