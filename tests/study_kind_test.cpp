// A kind of study from one file: this file defines it, and a study of it runs as any other. Then what all
// kinds have in common.
#include "harness/study/study_kind.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/cli/commands.h"
#include "harness/results/print.h"
#include "harness/study/scaling_row.h"
#include "harness/study/study_bench.h"
#include "harness/study/suite.h"
#include "tests/volume_files.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

// --- The kind `upload_time`: how long an upload takes ----------------------------------------------------

class UploadRunner final : public CaseRunner {
public:
    UploadRunner(const Scene& scene, const nlohmann::json& parameters)
        : scene_(scene), times_(parameters.at("times")) {}
    nlohmann::json answer(Backend& backend, const nlohmann::json&, const OnEvent&) override {
        const Timing timing = backend.timed([&] {
            for (int i = 0; i < times_; ++i) backend.upload(scene_.problem, scene_.state);
        });
        return timing.host_seconds / times_;
    }

private:
    const Scene& scene_;
    const int times_;
};

const RegisteredCaseRunner runner("upload_time", [](const BackendSpec&, const Scene& scene,
                                                    const nlohmann::json& parameters, SharedState*) {
    return std::make_unique<UploadRunner>(scene, parameters);
});

struct UploadRow : Row {
    std::string label_of_scene = {};

    static void fields(auto& row, auto& of) { of.required("label", row.label_of_scene); }
};

class UploadTime final : public StudyKind {
public:
    void read(JsonObject& study) override {
        times_ = int(study.require("times", "uploads of each backend").integer(1, 100));
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto label = item.find("label")) (void)label->string();
        return StudyKind::read_scene(item);
    }
    void check(const Study&, const StudyScene& item, const Scene& scene) const override {
        if (!scene.edits.empty()) throw BadInput("study", "scene", item.scene, "a scene without edits");
    }
    void run(StudyBench& bench) override {
        for (const BackendSpec& spec : bench.specs()) {
            auto entered = bench.enter(spec, {"upload_time", {{"times", times_}}});
            if (!entered) continue;
            UploadRow row{row_of(bench.scene().name, spec)};
            row.label_of_scene = bench.item().settings.value("label", "");
            row.counters.add("upload_seconds", entered->ask({{"do", "upload"}}, "uploading"), Unit::second,
                             Better::less);
            row.counters.add("voxels_per_byte", std::nullopt, Unit::number, Better::more);
            bench.add("uploads", row);
        }
    }
    void make_lists(Result& result) const override {
        result.rows<UploadRow>("uploads");
        result.rows<nlohmann::json>("slowest");
    }
    void summarise(Result& result) const override {
        double slowest = 0;
        for (const UploadRow& row : result.rows<UploadRow>("uploads"))
            slowest = std::max(slowest, row.counters.at("upload_seconds"));
        result.rows<nlohmann::json>("slowest") = {slowest};
    }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_rows<UploadRow>(result.rows<UploadRow>("uploads"),
                              {{{"label"}, [](const UploadRow& row) { return row.label_of_scene; }}}, width,
                              out);
    }

private:
    int times_ = 0;
};

const RegisteredStudyKind registered("upload_time", [] { return std::make_unique<UploadTime>(); });

// --- The kind `meeting`: suites that meet each other -----------------------------------------------------

/// cpu_reference as a backend of another API.
class Disguised : public WrappedBackend {
public:
    explicit Disguised(std::string family) : family_(std::move(family)) {}
    Capabilities capabilities() const override {
        Capabilities capabilities = WrappedBackend::capabilities();
        capabilities.family = family_;
        return capabilities;
    }

private:
    const std::string family_;
};

/// A backend that is edited once per run. Two runs are not timed and have one thread: the first one and that
/// from the strained start. All others have all threads: two repetitions, and three runs that time the edit
/// by itself. The bits of the latter are compared with those of the repetitions, which takes no further run.
class EditedWithAll final : public Disguised {
public:
    EditedWithAll() : Disguised("opengl") {}
    void upload(const Problem& problem, const State& start) override {
        is_strained_ = start.displacement_of(0) != glm::dvec3(0);
        Disguised::upload(problem, start);
    }
    void edit(const Problem& edited, const SpringEdit& edit) override {
        const bool timed = ++edits_ != 1 && !is_strained_;
        const int threads = omp_get_max_threads(), wanted = timed ? omp_get_num_procs() : 1;
        if (threads != wanted)
            throw DeviceError("edit " + std::to_string(edits_) + " with " + std::to_string(threads) +
                              " threads, not " + std::to_string(wanted));
        if (timed && edits_ > 6) throw DeviceError("a run more than are timed");
        Disguised::edit(edited, edit);
    }

private:
    int edits_ = 0;
    bool is_strained_ = false;
};

/// A cpu_reference that claims borders within steps, between devices that do not exist.
class OnDevices final : public WrappedBackend {
public:
    Capabilities capabilities() const override {
        Capabilities capabilities = WrappedBackend::capabilities();
        capabilities.has_borders = false;
        capabilities.border_ways = {"stores"};
        return capabilities;
    }
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>&,
                                                  const std::string&) override {
        throw Unavailable("there is no device");
    }
};
/// A backend that makes an edit only if it has just stepped: not if the device was idle before.
class MakesNoEditByItself final : public WrappedBackend {
public:
    void step(int count) override {
        WrappedBackend::step(count);
        idle_ = false;
    }
    void synchronize() override { idle_ = true; }
    void edit(const Problem& edited, const SpringEdit& edit) override {
        if (!idle_) WrappedBackend::edit(edited, edit);
    }

private:
    bool idle_ = false;
};
const Registered makes_no_edit_by_itself = registered_as<MakesNoEditByItself>("no_edit_by_itself");
/// A backend that does not take more than a hundred particles.
class TakesSmallOnes final : public WrappedBackend {
public:
    std::string unsupported(const Problem& problem) const override {
        return problem.particle_count() > 100 ? "too many particles" : "";
    }
};
const Registered takes_small_ones = registered_as<TakesSmallOnes>("takes_small_ones");
const std::vector<Registered> wrong_ones = register_wrong_backends();
const Registered edited_with_all = registered_as<EditedWithAll>("edited_with_all");
const Registered with_devices = registered_as<OnDevices>("on_devices");

/// A cpu_reference that displaces one layer of voxels.
class Nudged final : public WrappedBackend {
public:
    explicit Nudged(double z) : z_(z) {}
    void upload(const Problem& problem, const State& state) override {
        problem_ = &problem;
        WrappedBackend::upload(problem, state);
    }
    State download() override {
        State state = WrappedBackend::download();
        for (std::size_t i = 0; i < state.displacement.size(); ++i) {
            if (problem_->rest_position[i].z == z_) state.displacement[i].x += 1e-3;
        }
        return state;
    }

private:
    const double z_;
    const Problem* problem_ = nullptr;
};
const Registered nudged_in_sample = registered_as<Nudged>("nudged_12", 12),
                 nudged_beside = registered_as<Nudged>("nudged_7", 7);

const Registered all[] = {
    registered_as<Disguised>("device_1", "opengl"), registered_as<Disguised>("device_2", "opengl"),
    registered_as<Disguised>("device_3", "opengl"), registered_as<Disguised>("device_killed", "opengl"),
    registered_as<Disguised>("processor", "cpu")};

/// Leaves a mark; two of the devices wait for each other's mark.
class MeetingRunner final : public SuiteRunner {
public:
    MeetingRunner(std::string name, const nlohmann::json& parameters)
        : name_(std::move(name)), folder_(parameters.at("folder").get<std::string>()) {}

private:
    void run(Backend&, const nlohmann::json& known, const Once& once, const OnEvent& on_event) override {
        std::ofstream(folder_ / name_) << "here";
        on_event({{"found", name_}});
        once("meeting", [&]() -> Rows {
            if (name_ == "device_killed") (void)std::raise(SIGKILL);
            const bool met =
                (name_ != "device_2" || appears("device_3")) && (name_ != "device_3" || appears("device_2"));
            return {{"meetings", {{{"name", name_}, {"met", met}, {"known", known}}}}};
        });
    }
    bool appears(const std::string& name) const {
        constexpr std::chrono::milliseconds often(5);
        constexpr int patience = 4000;
        for (int i = 0; i < patience && !std::filesystem::exists(folder_ / name); ++i)
            std::this_thread::sleep_for(often);
        return std::filesystem::exists(folder_ / name);
    }

    const std::string name_;
    const std::filesystem::path folder_;
};

const RegisteredCaseRunner meeting_runner("meeting", [](const BackendSpec& spec, const Scene&,
                                                        const nlohmann::json& parameters, SharedState*) {
    return std::make_unique<MeetingRunner>(spec.entry->name, parameters);
});

class Meeting final : public StudyKind {
public:
    void read(JsonObject& study) override { folder_ = study.require("folder", "a path").string(); }
    void run(StudyBench& bench) override {
        nlohmann::json found = nlohmann::json::array();
        const CaseProgram program{"meeting", {{"folder", folder_}}};
        measure_suites(bench, {.enter = [&](const BackendSpec& spec) { return bench.enter(spec, program); },
                               .known = [&] { return found; },
                               .on_event = [&](const auto& event) { found.push_back(event.at("found")); }});
    }
    void print(const Result&, std::ostream&, TableWidth) const override {}

private:
    std::string folder_;
};

const RegisteredStudyKind meeting("meeting", [] { return std::make_unique<Meeting>(); });

// --- The kind `thread_count`: threads of a case's process ------------------------------------------------

class ThreadCountRunner final : public CaseRunner {
    nlohmann::json answer(Backend&, const nlohmann::json&, const OnEvent&) override {
        return omp_get_max_threads();
    }
};
const RegisteredCaseRunner thread_count_runner("thread_count", [](const BackendSpec&, const Scene&,
                                                                  const nlohmann::json&, SharedState*) {
    return std::make_unique<ThreadCountRunner>();
});

/// Counts threads of cases that run one by one, at once, and one by one again.
class ThreadCount final : public StudyKind {
    void run(StudyBench& bench) override {
        for (const bool at_once : {false, true, false}) {
            for (Case& one : bench.enter_all(bench.specs(), {"thread_count"}, {.at_once = at_once})) {
                const nlohmann::json threads = one.ask({{"do", "count"}}, "counting");
                bench.add("threads", {{"name", one.spec().entry->name}, {"threads", threads}});
                one.dismiss();
            }
        }
    }
    void print(const Result&, std::ostream&, TableWidth) const override {}
};

const RegisteredStudyKind thread_count("thread_count", [] { return std::make_unique<ThreadCount>(); });

// --- Tests -----------------------------------------------------------------------------------------------

class StudyKinds : public ::testing::Test {
protected:
    std::string write(const std::string& name, const std::string& text) const {
        return folder_.write(name, text);
    }
    nlohmann::json run(const std::string& study, const StudyOptions& options = {}) const {
        return run_study(load_study(write("study.json", study)), options);
    }
    /// A study of scaling with these keys, on at most so many ranks.
    nlohmann::json scaling(const std::string& keys, std::optional<int> ranks = {},
                           const std::vector<int>& devices = {}) const {
        StudyOptions options;
        options.ranks = ranks;
        options.devices = devices;
        return run(R"({"kind": "scaling", )" + keys + "}", options);
    }
    const TemporaryFolder folder_;
};

/// A study of cpu_reference, as a program builds it.
Study study_of(const std::string& kind, const std::vector<StudyScene>& scenes,
               const nlohmann::json& settings = nlohmann::json::object()) {
    Study study;
    study.name = "test";
    study.kind = kind;
    study.repetitions = 2;
    study.steps = 3;
    study.settings = settings;
    study.backends = {"cpu_reference"};
    study.scenes = scenes;
    return study;
}
Study timing_of(const std::vector<StudyScene>& scenes) {
    return study_of("timing", scenes, {{"total_error", false}});
}

/// Keys of scaling: short runs of cpu_reference on a small box.
const std::string short_runs = R"("repetitions": 1, "steps": 3)";
const std::string short_reference =
    short_runs + R"(, "backends": ["cpu_reference"], "scenes": [{"scene": "box@6"}])";

void expect_contains(const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
}

TEST_F(StudyKinds, OneOfOnesOwnRunsAsAnyOther) {
    const std::string study = write("uploads.json", R"({"kind": "upload_time", "times": 3,
        "backends": ["cpu_*"], "scenes": [{"scene": "box@4", "label": "small"}, {"scene": "box@5"}]})");
    const nlohmann::json result = run_study(load_study(study), {});
    ASSERT_EQ(result.at("uploads").size(), 6u) << "three backends on two scenes";
    EXPECT_EQ(result.at("uploads")[0].at("label"), "small");
    EXPECT_GT(result.at("slowest")[0].get<double>(), 0);
    // The stand-in metric: named where it is measured, then in the rows, described once, and in the table.
    EXPECT_GT(result.at("uploads")[0].at("upload_seconds").get<double>(), 0);
    EXPECT_FALSE(result.at("uploads")[0].contains("counters"));
    const nlohmann::json& described = result.at("context").at("voxspring").at("counters");
    EXPECT_EQ(described.at("upload_seconds"), nlohmann::json({{"unit", "s"}, {"better", "less"}}));
    EXPECT_EQ(described.at("voxels_per_byte"), nlohmann::json({{"unit", ""}, {"better", "more"}}));
    EXPECT_TRUE(result.at("uploads")[0].at("voxels_per_byte").is_null()) << "it is not known";
    EXPECT_EQ(nlohmann::json(read_result(result)), result) << "read as it was written";
    EXPECT_EQ(result.at("context").at("voxspring").at("study").at("kind"), "upload_time");
    std::ostringstream printed;
    EXPECT_EQ(run_and_print_study(study, {}, printed), 0);
    EXPECT_THAT(printed.str(),
                ::testing::ContainsRegex("scene +backend +label +upload seconds +voxels per byte\n"
                                         "box@4 +cpu_[a-z_0-9 ]+ small +[0-9.]+ [mun]?s +-\n"));
}

TEST_F(StudyKinds, SuitesOfDevicesGoSideBySide) {
    StudyOptions options;
    options.side_by_side = 3;
    const nlohmann::json result =
        run(R"({"kind": "meeting", "folder": ")" + folder_.path().string() +
                R"(", "backends": ["device_*", "processor"], "scenes": [{"scene": "box@2"}]})",
            options);

    const nlohmann::json& meetings = result.at("meetings");
    ASSERT_EQ(meetings.size(), 4u);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(meetings[i].at("name"), "device_" + std::to_string(i + 1));
    EXPECT_EQ(meetings[0].at("known"), nlohmann::json::array()) << "the first one is told nothing";
    EXPECT_EQ(meetings[1].at("met"), true) << "the third was at work as well";
    EXPECT_EQ(meetings[2].at("met"), true);
    EXPECT_EQ(meetings[1].at("known"), nlohmann::json({"device_1"})) << "which was alone before";
    EXPECT_EQ(meetings[3].at("name"), "processor");
    EXPECT_EQ(meetings[3].at("known"), nlohmann::json({"device_1", "device_2", "device_3", "device_killed"}))
        << "a processor's suite waits for those of all devices";
    ASSERT_EQ(result.at("failed").size(), 1u) << "and takes no other along";
    EXPECT_EQ(result.at("failed")[0].at("backend"), "device_killed");
    expect_contains(result.at("failed")[0].at("reason"), "meeting: was killed by signal 9");
}

TEST_F(StudyKinds, CasesAtOnceShareTheProcessors) {
    StudyOptions options;
    const int processors = omp_get_num_procs();
    options.side_by_side = processors;
    const nlohmann::json result = run(R"({"kind": "thread_count",
        "backends": ["device_1", "processor", "cpu_parallel"], "scenes": [{"scene": "box@2"}]})",
                                      options);
    ASSERT_EQ(result.at("failed"), nlohmann::json::array());
    std::vector<std::pair<std::string, int>> found;
    for (const auto& row : result.at("threads")) found.emplace_back(row.at("name"), row.at("threads"));
    const std::vector<std::pair<std::string, int>> alone = {
        {"device_1", processors}, {"processor", processors}, {"cpu_parallel", processors}};
    std::vector<std::pair<std::string, int>> expected = alone;
    // A backend that steps on the processor keeps all processors.
    expected.insert(expected.end(), {{"device_1", 1}, {"processor", 1}, {"cpu_parallel", processors}});
    expected.insert(expected.end(), alone.begin(), alone.end());
    EXPECT_EQ(found, expected);
}

TEST_F(StudyKinds, EditsAreTimedWithAllProcessors) {
    const std::string scene = write("cut.json", R"({"dataset": {"type": "box", "dims": [6, 6, 6]},
        "time_step": {"fraction_of_stable": 0.5}, "edits": [{"step": 3, "cut": {"triangles":
        [[[2.5, -1, -1], [2.5, 9, -1], [2.5, 9, 9]], [[2.5, -1, -1], [2.5, 9, 9], [2.5, -1, 9]]]}}]})");
    StudyOptions options;
    options.side_by_side = omp_get_num_procs();
    const nlohmann::json result =
        run(R"({"kind": "timing", "repetitions": 2, "steps": 8, "start_times": false,
        "backends": ["edited_with_all"], "scenes": [{"scene": ")" +
                scene + R"("}]})",
            options);
    EXPECT_EQ(result.at("failed"), nlohmann::json::array());
    EXPECT_EQ(result.at("verification").size(), 1U) << result.at("skipped");
}

TEST_F(StudyKinds, ReadAndCheckTheirOwnKeys) {
    const std::string start = R"({"kind": "upload_time", "backends": ["cpu_*"], )";
    for (const auto& [rest, word] :
         {std::pair(R"("scenes": [{"scene": "box@4"}]})", "times"),
          {R"("times": 3, "targets": [], "scenes": [{"scene": "box@4"}]})", "targets"},
          {R"("times": 3, "scenes": [{"scene": "scalpel_1"}]})", "without edits"}})
        expect_contains(refusal([&, &keys = rest] { (void)run(start + keys); }), word);
    // A study that a program builds is read by the same code.
    Study study = study_of("upload_time", {{"box@4", 4, {}}});
    expect_contains(refusal([&] { (void)run_study(study, {}); }), "times");
    study.kind = "downloads";
    expect_contains(refusal([&] { (void)run_study(study, {}); }), "upload_time");
}

// --- What all kinds have in common ------------------------------------------------------------------------

TEST_F(StudyKinds, RefuseWhatTheyWouldMeasureWrongly) {
    const auto refuse = [](const Study& study, const std::string& words) {
        expect_contains(refusal([&] { (void)run_study(study, {}); }), words);
    };
    refuse(study_of("overhead", {{"press", 4, {}}}), "scene press: a tool that moves");
    // A ball of six voxels across would be five high instead of four and a half.
    refuse(study_of("truth", {{"ball", 4, {}}}, {{"voxels_across", {4, 6}}}), "voxels_across of ball: 6");
    refuse(study_of("pareto", {{"box@4", 1, {}}}, {{"time_steps", {0.9, 0.8}}}), "time_steps: 0.8");
    Problem pair;
    pair.rest_position = {{0, 0, 0}, {1, 0, 0}};
    pair.springs = {{0, 1, 1.0, 1.0}};
    StudyScene built{"pair", 4, {}};
    built.built = std::make_shared<const Scene>(scene_of("pair", pair));
    refuse(study_of("stability", {built}), "scene pair: particles on no lattice");
}

TEST_F(StudyKinds, OverheadHandsStepsOverInTwoWays) {
    const nlohmann::json result = run_study(study_of("overhead", {{"box@4", 20, {}}}), {});
    ASSERT_EQ(result.at("overhead").size(), 2u) << result.at("failed");
    std::vector<std::string> ways;
    for (const auto& row : result.at("overhead")) {
        ways.push_back(row.at("handed_over"));
        EXPECT_GT(row.at("host_seconds_per_step"), 0.0);
        EXPECT_GT(row.at("seconds_per_step"), 0.0);
    }
    EXPECT_EQ(ways, (std::vector<std::string>{"one by one", "at once"}));
}

/// The specifications of faults() as a JSON array, and how many there are.
std::string wrong_backends() {
    nlohmann::json names = nlohmann::json::array();
    for (const auto& [name, fault] : faults()) names.push_back(name);
    return names.dump();
}
/// Whether `backend` is right on a scene without a tool, in which nothing but `edited` needs edits.
bool is_right(const std::string& backend, bool edited) {
    return backend == "wrong_in_nothing" || backend == "wrong_force" || (backend == "wrong_uncut" && !edited);
}

// The shortest of the study's own scenes.
TEST_F(StudyKinds, OverheadHasNoRowOfAWrongBackend) {
    for (const char* scene : {"box@2", "box@8"}) {
        const nlohmann::json result =
            run(R"({"kind": "overhead", "repetitions": 2, "steps": 2000, "backends": )" + wrong_backends() +
                R"(, "scenes": [{"scene": ")" + scene + R"("}]})");
        EXPECT_EQ(result.at("overhead").size() + 2 * result.at("failed").size(), 2 * faults().size());
        EXPECT_EQ(result.at("failed").size(), 4U) << result.at("failed");
        for (const auto& row : result.at("overhead")) {
            SCOPED_TRACE(row.dump());
            EXPECT_TRUE(is_right(row.at("backend"), false));
            EXPECT_EQ(row.at("passed"), true);
            EXPECT_EQ(row.at("repetitions_judged"), 2);
            EXPECT_GT(row.at("strained_share"), 0.5);
            EXPECT_LT(row.at("error_rms"), row.at("tolerance_rms"));
            EXPECT_LT(row.at("tolerance_rms"), 0.1 * row.at("motion_rms").get<double>());
        }
    }
}

// The box of the study `edits`, smaller; a cut of two springs' depth at its free end.
TEST_F(StudyKinds, EditsHaveNoTimeOfAWrongBackend) {
    const std::string scene = write("cut.json", R"({"dataset": {"type": "box", "dims": [8, 8, 16]},
        "pinned": {"side": "z-"}, "gravity": [8e-4, 0, -2e-3], "time_step": {"fraction_of_stable": 0.5},
        "edits": [{"step": 50, "cut": {"triangles":
        [[[3.5, -0.5, 13.5], [3.5, 1.5, 13.5], [3.5, 1.5, 20]],
         [[3.5, -0.5, 13.5], [3.5, 1.5, 20], [3.5, -0.5, 20]]]}}]})");
    const nlohmann::json result = run(R"({"kind": "timing", "repetitions": 2, "steps": 100,
        "start_times": false, "backends": )" +
                                      wrong_backends() + R"(, "scenes": [{"scene": ")" + scene + R"("}]})");
    EXPECT_EQ(result.at("failed").size(), faults().size() - 2) << result.at("failed");
    for (const auto& row : result.at("benchmarks")) EXPECT_TRUE(is_right(row.at("backend"), true)) << row;
    for (const auto& row : result.at("verification")) {
        if (!is_right(row.at("backend"), true)) continue;
        EXPECT_EQ(row.at("repetitions_judged"), 2);
        EXPECT_GT(row.at("strained_share"), 0.5);
    }
}

TEST_F(StudyKinds, AnEditThatIsTimedByItselfIsMade) {
    const std::string scene = write("cut.json", R"({"dataset": {"type": "box", "dims": [6, 6, 6]},
        "gravity": [8e-4, 0, -2e-3], "pinned": {"side": "z-"}, "time_step": {"fraction_of_stable": 0.5},
        "edits": [{"step": 3, "cut": {"plane": {"point": [2.5, 0, 0], "normal": [1, 0, 0]}}}]})");
    const nlohmann::json result =
        run(R"({"kind": "timing", "repetitions": 2, "steps": 20, "start_times": false,
        "backends": ["no_edit_by_itself"], "scenes": [{"scene": ")" +
            scene + R"("}]})");
    EXPECT_EQ(result.at("benchmarks"), nlohmann::json::array());
    ASSERT_EQ(result.at("failed").size(), 1U);
    expect_contains(result.at("failed")[0].at("reason"), "edits timed by themselves");
}

// Four voxels across are 64 particles at centres, and 125 at corners.
TEST_F(StudyKinds, TruthNamesTheLatticesThatABackendDoesNotTake) {
    const auto skipped_of = [&](const std::string& across, std::size_t rows) {
        const nlohmann::json result = run(R"({"kind": "truth", "backends": ["takes_small_ones"],
            "scenes": [{"scene": "cube"}], "voxels_across": )" +
                                          across + "}");
        EXPECT_EQ(result.at("truth").size(), rows) << result.at("failed");
        EXPECT_EQ(result.at("skipped").size(), 1u) << result.at("skipped");
        return result.at("skipped").at(0).at("reason").get<std::string>();
    };
    EXPECT_EQ(skipped_of("[2, 4]", 6), "particles at corners, 4 across: too many particles");
    EXPECT_EQ(skipped_of("[4]", 2), "particles at corners: too many particles");
}

/// A scene that ranks share, and one that grows with them.
const std::string growing =
    R"("scenes": [{"scene": "box@8"}, {"scene": "box@4x4x4", "ranks": [1], "weak": "growing"},
                  {"scene": "box@4x4x8", "ranks": [2], "weak": "growing"}])";

TEST_F(StudyKinds, ScalingComparesRanksWithOne) {
    const nlohmann::json result = scaling(R"("repetitions": 2, "steps": 12, "ranks": [1, 2, 3, 9],
        "backends": ["cpu_parallel:formulation=position", "cpu_reference"], )" +
                                              growing,
                                          3);
    EXPECT_TRUE(result.at("failed").empty()) << result.at("failed");
    ASSERT_EQ(result.at("scaling").size(), 2u * (3 + 2));
    for (const auto& row : result.at("scaling")) {
        const int ranks = row.at("ranks");
        const bool grows = row.at("family") == "growing";
        EXPECT_EQ(row.at("scaling"), grows ? "weak" : "strong");
        EXPECT_EQ(row.at("way"), ranks == 1 ? "none" : "memory");
        EXPECT_EQ(row.at("same_bits").is_null(), ranks == 1 || grows);
        EXPECT_NE(row.at("same_bits"), false);
        const double efficiency = row.at("efficiency");
        EXPECT_GT(efficiency, 0);
        EXPECT_TRUE(ranks > 1 || efficiency == 1) << efficiency;
        EXPECT_GT(row.at("predicted_seconds"), 0.0);
        EXPECT_GT(row.at("compute_seconds"), 0.0);
        EXPECT_EQ(row.at("latency_seconds").is_null(), ranks == 1);
        EXPECT_LT(row.at("error_max"), 1e-3);
    }
    // Two slabs of a box of 8 layers and two ghost layers.
    EXPECT_EQ(result.at("scaling")[1].at("ghosts"), 2 * 64);
    EXPECT_EQ(result.at("scaling")[1].at("largest_part"), 5 * 64);
}

TEST(ScalingModel, SaysFromWhichSizeOnMoreThanOneRankPays) {
    constexpr double particle = 1e-9, latency = 1e-5;
    const auto row_of = [&](int ranks, std::uint64_t particles, const std::string& way) {
        ScalingRow row;
        row.workpiece = Workpiece{.steps = 1, .particles = particles, .springs = 1};
        row.ranks = ranks;
        row.way = way;
        row.seconds_per_step = particle * double(particles) / ranks;
        row.largest_part = (particles + std::uint64_t(ranks) - 1) / std::uint64_t(ranks);
        if (ranks > 1) row.latency_seconds = latency;
        return row;
    };
    const ScalingRow one = row_of(1, 1'000'000, "none");
    ScalingRow two = row_of(2, 1'000'000, "stores");
    compare(two, one);
    EXPECT_DOUBLE_EQ(*two.efficiency, 1);
    EXPECT_DOUBLE_EQ(*two.predicted_seconds, particle * 500'000 + latency);
    // At this size half of the particles take as long as the exchange does.
    EXPECT_NEAR(*two.pays_from_particles, 2 * latency / particle, 1);
    two.way = "stores_overlap";
    compare(two, one);
    // With overlap all particles take as long as half of them and the exchange.
    EXPECT_NEAR(*two.pays_from_particles, latency / particle, 1);

    // Borders grow with the square of the length: at the stated size both sides are equal.
    two.way = "stores";
    two.largest_part += 10'000;
    two.border_bytes = 160'000;
    two.seconds_per_byte = 1e-10;
    compare(two, one);
    const double volume = *two.pays_from_particles / 1e6, area = std::pow(volume, 2.0 / 3);
    const double of_two = particle * (500'000 * volume + 10'000 * area) + latency + 1.6e-5 * area;
    EXPECT_NEAR(of_two, particle * *two.pays_from_particles, 1e-9 * of_two);
    // An exchange within steps has no measured times, so nothing is predicted.
    two.latency_seconds.reset();
    two.pays_from_particles.reset();
    compare(two, one);
    EXPECT_FALSE(two.pays_from_particles);
}

TEST_F(StudyKinds, ScalingSaysWhetherMoreThanOneRankPays) {
    nlohmann::json result =
        scaling(short_runs + R"(, "ranks": [1, 2, 3], "backends": ["cpu_reference"], )" + growing, 3);
    const auto said = [&](double of_two, double of_three) {
        for (auto& row : result.at("scaling")) {
            const int ranks = row.at("ranks");
            row["seconds_per_step"] = ranks == 1 ? 1 : ranks == 2 ? of_two : of_three;
            row["pays_from_particles"] = nullptr;
            row["noisy"] = nlohmann::json::array();
            if (ranks == 2) row["pays_from_particles"] = 2e6;
            if (ranks == 3) row["noisy"] = {"ranks share a device"};
        }
        std::ostringstream printed;
        print_result(read_result(result), printed);
        return printed.str();
    };
    const std::string box = "box@8 cpu_reference increment float64: several ranks ";
    EXPECT_THAT(said(0.6, 0.4),
                ::testing::HasSubstr(
                    box + "pay: 3 ranks (parts 1x1x3, messages by memory) are 2.50 times as fast as one "
                          "(ranks share a device)\n"));
    EXPECT_THAT(said(2, 4),
                ::testing::HasSubstr(
                    box + "do not pay: 2 ranks (parts 1x1x2, messages by memory) are 0.50 times as fast as "
                          "one; by the model they are faster from 2000000 particles of this shape on\n"));
    // For 512 particles the model must not contradict the measurement.
    for (auto& row : result.at("scaling"))
        row["pays_from_particles"] = row.at("ranks") == 2 ? nlohmann::json(100) : nullptr;
    std::ostringstream contradicted;
    print_result(read_result(result), contradicted);
    EXPECT_THAT(
        contradicted.str(),
        ::testing::HasSubstr("0.50 times as fast as one; the model contradicts this: by it they are faster "
                             "from 100 particles of this shape on\n"));
    EXPECT_THAT(said(2, 4),
                ::testing::Not(::testing::HasSubstr("box@4x4x4 cpu_reference increment float64: several")))
        << "it grows";
}

TEST_F(StudyKinds, ScalingSkipsTheWaysOfOtherBackends) {
    const std::string keys =
        short_runs + R"(, "ranks": [1, 2], "backends": ["on_devices"], "scenes": [{"scene": "box@4"}])";
    expect_contains(scaling(keys, 2).at("skipped").dump(), "its ranks run on CUDA devices: choose them");
    const nlohmann::json result = scaling(keys, 2, {0, 1});
    EXPECT_TRUE(result.at("failed").empty()) << result.at("failed");
    ASSERT_EQ(result.at("scaling").size(), 1u);
    EXPECT_EQ(result.at("scaling")[0].at("way"), "none");
    const std::string skipped = result.at("skipped").dump();
    for (const char* way : {"memory", "peer", "nccl"}) expect_contains(skipped, way);
    expect_contains(skipped, ": its borders travel within its steps");
    expect_contains(skipped, "as 2 ranks of 1x1x2 by stores: rank ");
    expect_contains(skipped, "there is no device");
    EXPECT_EQ(skipped.find("mpi"), std::string::npos);
    EXPECT_EQ(result.at("skipped").size(), 2u);
}

TEST_F(StudyKinds, ScalingLetsTilesFallAsleepOtherwiseInSlabs) {
    const nlohmann::json result = scaling(R"("repetitions": 1, "steps": 100, "ranks": [1, 2],
        "backends": ["cpu_parallel:formulation=increment,sleep=1e-3"], "scenes": [{"scene": "poke@12"}])",
                                          2);
    ASSERT_EQ(result.at("scaling").size(), 2u) << result.at("failed");
    EXPECT_EQ(result.at("scaling")[1].at("same_bits"), false);
}

TEST_F(StudyKinds, ScalingReadsItsOwnKeys) {
    for (const auto& [keys, words] :
         {std::pair(R"("ranks": [2, 1])", "ascending order"),
          {R"("ranks": [0])", "1 to 1024"},
          {R"("ways": ["ship"])",
           "memory, mpi, peer, peer_overlap, stores, stores_overlap, nccl, nccl_overlap"},
          {R"("ways": [])", "ways"},
          {R"("cuts": ["halves"])", "slabs, layers, bricks"}})
        expect_contains(refusal([&, &key = keys] { (void)scaling(short_reference + ", " + key); }), words);
    const Study timing = timing_of({{"box@4", 4, {}}});
    StudyOptions options;
    options.ranks = 2;
    expect_contains(refusal([&] { (void)run_study(timing, options); }), "not of the kind scaling");
    StudyOptions on_devices;
    on_devices.devices = {0, 2};
    expect_contains(refusal([&] { (void)run_study(timing, on_devices); }), "--devices: 0,2");
}

TEST_F(StudyKinds, ScalingMeasuresTheWaysThatAreAskedFor) {
    const auto ways = [&](const std::string& study) {
        std::vector<std::string> measured;
        const nlohmann::json result = scaling(study, 2);
        for (const auto& row : result.at("scaling")) measured.push_back(row.at("way"));
        return measured;
    };
    using Ways = std::vector<std::string>;
    EXPECT_EQ(ways(short_reference + R"(, "ways": ["memory", "peer"])"), (Ways{"none", "memory"}));
    EXPECT_EQ(ways(short_reference + R"(, "ways": ["peer"])"), Ways{"none"});
    EXPECT_EQ(ways(R"("repetitions": 1, "steps": 4, "ranks": [1, 2], "backends": ["cpu_parallel"], "scenes": [
                  {"scene": "box@4", "ways": ["peer"]}, {"scene": "box@5", "ways": ["memory"]}])"),
              (Ways{"none", "none", "memory"}));
}

TEST_F(StudyKinds, ScalingSaysWhatItDoesNotMeasure) {
    const auto skipped = [&](const std::string& keys) {
        return scaling(short_reference + ", " + keys, 2).at("skipped").dump();
    };
    expect_contains(skipped(R"("ranks": [1, 2], "ways": ["peer", "mpi"])"), "as 2 ranks by peer, mpi: ");
    expect_contains(skipped(R"("ranks": [3, 4])"), "asks for 3 ranks or more here, and 2 are the most");
    EXPECT_EQ(skipped(R"("ranks": [1, 2, 4])"), "[]") << "larger numbers are left out";
}

TEST_F(StudyKinds, ScalingVerifiesASampleWhereItIsAskedTo) {
    const auto measured = [&](const std::string& backends, const std::string& layers, int ranks = 2) {
        return scaling(R"("repetitions": 1, "steps": 4, "backends": [)" + backends +
                           R"(], "scenes": [{"scene": "box@6x6x24", "sample_layers": )" + layers + "}]",
                       ranks);
    };
    const nlohmann::json rows = measured(R"("cpu_parallel:formulation=position")", "2").at("scaling");
    ASSERT_EQ(rows.size(), 2u);
    for (const auto& row : rows) {
        EXPECT_EQ(row.at("judged_particles"), 6 * 6 * (3 + 4 + 3)) << "a layer beside each";
        EXPECT_GT(row.at("error_relative_l2"), 0);
        EXPECT_EQ(row.at("total_error_reason"), "only a sample of the body is verified");
    }
    EXPECT_EQ(rows[1].at("same_bits"), true);
    std::ostringstream out;
    print_result(read_result(measured(R"("cpu_reference")", "2")), out);
    expect_contains(out.str(), "are measured on a sample of 360 of 864 particles");

    const nlohmann::json wrong = measured(R"("nudged_7", "nudged_12")", "2", 1);
    ASSERT_EQ(wrong.at("failed").size(), 1u) << wrong.at("failed");
    EXPECT_EQ(wrong.at("failed")[0].at("backend"), "nudged_12");
    ASSERT_EQ(wrong.at("scaling").size(), 1u) << "what lies beside the sample is not seen";
    EXPECT_EQ(wrong.at("scaling")[0].at("backend"), "nudged_7");

    const std::string why = refusal([&] { (void)measured(R"("cpu_reference")", "7"); });
    expect_contains(why, "sample_layers of box@6x6x24: 7");
}

TEST_F(StudyKinds, ScalingPredictsTheLongerOfStepAndExchangeWhereTheyOverlap) {
    nlohmann::json result = scaling(short_reference, 2);
    nlohmann::json& one = result.at("scaling")[0];
    nlohmann::json& two = result.at("scaling")[1];
    ASSERT_EQ(two.at("ranks"), 2);
    one["seconds_per_step"] = 216e-6;  // a microsecond per particle
    two["largest_part"] = 144;
    two["border_bytes"] = 1000;
    two["seconds_per_byte"] = 1e-9;
    const auto predicted = [&](const std::string& way, double latency) {
        two["way"] = way;
        two["latency_seconds"] = latency;
        Result again = read_result(result);
        make_study_kind("scaling")->summarise(again);
        return again.rows<ScalingRow>("scaling")[1].predicted_seconds.value();
    };
    EXPECT_NEAR(predicted("peer", 9e-6), 154e-6, 1e-12);
    EXPECT_NEAR(predicted("peer_overlap", 9e-6), 144e-6, 1e-12);
    EXPECT_NEAR(predicted("nccl_overlap", 299e-6), 300e-6, 1e-12);
}

TEST(ScalingKind, LeavesWhatCannotStepAPartOutOfWhatAutoChooses) {
    const auto scaling = make_study_kind("scaling");
    EXPECT_FALSE(scaling->takes({}));
    Capabilities gives_borders, steps_together;
    gives_borders.has_borders = true;
    steps_together.border_ways = {"stores"};
    EXPECT_TRUE(scaling->takes(gives_borders));
    EXPECT_TRUE(scaling->takes(steps_together));
    EXPECT_TRUE(make_study_kind("timing")->takes({}));
}

TEST_F(StudyKinds, ScalingHasARankADeviceAtMost) {
    const std::string keys = short_reference + R"(, "ranks": [1, 2, 3, 4])";
    EXPECT_EQ(scaling(keys, {}, {0, 0, 0}).at("scaling").size(), 3u);
    EXPECT_EQ(scaling(keys, 4, {0, 0, 0}).at("scaling").size(), 5u) << "four as bricks as well";
}

// In three steps from rest gravity moves almost all particles alike, so that springs hardly matter.
TEST_F(StudyKinds, ScalingIsVerifiedFromAStartThatStrainsItsSprings) {
    for (const bool strained : {false, true}) {
        const std::string keys = strained ? R"(, "strained_start": true)" : "";
        const auto rows =
            scaling(
                R"("backends": ["cpu_parallel:formulation=position"], "ranks": [1, 2], "repetitions": 2, "steps": 3,
                       "scenes": [{"scene": "box@6x6x24")" +
                    keys + "}]",
                2)
                .at("scaling");
        ASSERT_EQ(rows.size(), 2u);
        for (const auto& row : rows) {
            EXPECT_TRUE(row.at("passed"));
            EXPECT_EQ(row.at("strained_share").get<double>() >= 0.5, strained) << row;
            EXPECT_NE(row.at("same_bits"), false);
        }
    }
}

// Catches a start that is not strained: three steps from rest would need a second run.
TEST_F(StudyKinds, TimedStepsBeginAtAStrainedStartIfTheFileAsks) {
    const auto of = [&](const std::string& keys) {
        return run(R"({"kind": "timing", "backends": ["cpu_parallel:formulation=position"], "repetitions": 2,
                       "steps": 3, "start_times": false, "scenes": [{"scene": "box@6x6x24")" +
                   keys + "}]}");
    };
    const nlohmann::json plain = of(""),
                         strained = of(
                             R"(, "strained_start": true}, {"scene": "box@6x6x24", "strained_start": true)");
    EXPECT_TRUE(plain.at("verification")[0].contains("strained_start"));
    EXPECT_FALSE(plain.at("context").at("voxspring").at("study").contains("strained_starts"));
    const nlohmann::json& verdict = strained.at("verification")[0];
    EXPECT_FALSE(verdict.contains("strained_start")) << "a second run";
    EXPECT_TRUE(verdict.at("passed"));
    EXPECT_GE(verdict.at("strained_share"), 0.5);
    EXPECT_EQ(strained.at("context").at("voxspring").at("study").at("strained_starts"),
              nlohmann::json::array({"box@6x6x24"}));
    expect_contains(refusal([&] { (void)of(R"(}, {"scene": "box@6x6x24", "strained_start": true)"); }),
                    "strained_start of box@6x6x24: true");
}

TEST_F(StudyKinds, ScalingCutsIntoBricksWhereTheseHaveLessBorder) {
    const auto rows = [&](const std::string& keys) {
        return scaling(short_reference + ", " + keys, 4).at("scaling");
    };
    const nlohmann::json measured = rows(R"("ranks": [1, 2, 4])");
    ASSERT_EQ(measured.size(), 4u) << measured;
    std::vector<std::string> cuts;
    for (const auto& row : measured) {
        cuts.push_back(row.at("cut"));
        EXPECT_NE(row.at("same_bits"), false);
    }
    EXPECT_EQ(cuts, (std::vector<std::string>{"1x1x1", "1x1x2", "1x1x4", "1x2x2"}));
    // A slab between others sends two layers; a brick sends two faces, and the edge between them once more.
    const int of_slab = measured[2].at("border_bytes"), of_brick = measured[3].at("border_bytes");
    EXPECT_EQ(of_slab * (2 * 18 + 6), of_brick * 2 * 36);
    EXPECT_EQ(rows(R"("ranks": [1, 2, 4], "cuts": ["slabs"])").size(), 3u);
    EXPECT_EQ(rows(R"("ranks": [1, 2, 4], "cuts": ["bricks"])").size(), 2u) << "one rank, and bricks of four";
}

TEST_F(StudyKinds, TwoScenesOfOneNameAreRefusedUnlessTheyAreTheSame) {
    std::filesystem::create_directory(folder_.path() / "other");
    const std::string text = R"({"dataset": {"type": "box", "dims": [4, 4, 4]}})";
    const std::string first = write("body.json", text), same = write("other/body.json", text);
    if (const std::string why = refusal([&] { (void)load_scene(first); }); why != "accepted") FAIL() << why;
    EXPECT_EQ(run_study(timing_of({{first, 3, {}}, {same, 3, {}}}), {}).rows("verification").size(), 2u);
    const std::string other = write("other/body.json", R"({"dataset": {"type": "box", "dims": [5, 4, 4]}})");
    const std::string why = refusal([&] {
        (void)run_study(timing_of({{first, 3, {}}, {other, 3, {}}}), {});
    });
    expect_contains(why, "other/body.json");
    expect_contains(why, "rename the file");
}

TEST_F(StudyKinds, ASceneIsMeasuredOnceHoweverManyGlobsMatchIt) {
    StudyOptions options;
    options.scenes = {"box*", "box@4", "box@6", "box@6"};
    const nlohmann::json result = run_study(timing_of({{"box@4", 3, {}}, {"box@5", 3, {}}}), options);
    EXPECT_EQ(result.at("verification").size(), 3u) << "box@4, box@5 and box@6";
}

TEST_F(StudyKinds, ALargeSceneTakesFewerStepsWhereTheStudySaysSo) {
    (void)write("cut.json", R"({"dataset": {"type": "box", "dims": [6, 6, 6]},
        "edits": [{"step": 2, "cut": {"plane": {"point": [1.5, 0, 0], "normal": [1, 0, 0]}}}]})");
    std::map<std::string, int> steps, errors_after;
    const nlohmann::json result = run(R"({"most_particle_steps": 200, "steps": 3, "repetitions": 2,
        "total_error": false, "backends": ["cpu_reference"],
        "scenes": [{"scene": "box@4"}, {"scene": "box@5"}, {"scene": "box@6"}, {"scene": "cut.json"}]})");
    for (const auto& row : result.at("benchmarks")) {
        if (row.at("run_type") == "iteration") steps[row.at("scene")] = row.at("iterations");
        errors_after[row.at("scene")] = row.at("error_steps");
    }
    const std::map<std::string, int> expected = {{"box@4", 3}, {"box@5", 1}, {"box@6", 1}, {"cut.json", 3}};
    EXPECT_EQ(steps, expected);
    EXPECT_EQ(errors_after, expected);
}

TEST_F(StudyKinds, ASlowCaseMakesFewerRepetitionsWhichIsSaid) {
    std::map<std::string, int> repetitions;
    const nlohmann::json result = run(R"({"most_case_seconds": 0.001, "steps": 100, "repetitions": 5,
        "total_error": false, "backends": ["cpu_reference"], "scenes": [{"scene": "box@2"}, {"scene": "box@8"}]})");
    for (const auto& row : result.at("benchmarks")) {
        if (row.at("run_type") == "iteration") ++repetitions[row.at("scene")];
    }
    // A step of 512 particles takes more than 10 us.
    const std::map<std::string, int> expected = {{"box@2", 5}, {"box@8", 2}};
    EXPECT_EQ(repetitions, expected);
    std::ostringstream printed;
    print_result(read_result(result), printed);
    expect_contains(printed.str(),
                    "1 of 2 times with fewer than 5 repetitions, since these took long: box@8: cpu_reference "
                    "increment float64 (2)\n");
}

TEST_F(StudyKinds, TheBackendThatIsAskedForIsPlayedWhereTheStudyHasIt) {
    const auto rows_of = [&](const std::string& glob) {
        Study study = timing_of({{"box@4", 3, {"cpu_reference"}},
                                 {"box@4", 3, {"cpu_parallel"}},
                                 {"box@5", 3, {"cpu_reference"}}});
        StudyOptions options;
        options.backends = {glob};
        ::testing::internal::CaptureStderr();
        const nlohmann::json result = run_study(study, options);
        std::vector<std::string> rows = {::testing::internal::GetCapturedStderr()};
        rows[0] = rows[0].substr(0, rows[0].find("[1/"));
        for (const auto& row : result.at("verification"))
            rows.push_back(row.at("scene").get<std::string>() + " " + row.at("backend").get<std::string>() +
                           " " + row.at("precision").get<std::string>());
        return rows;
    };
    const std::string left_out = "voxspring: --backend leaves these scenes without a backend: ";
    EXPECT_THAT(rows_of("cpu_parallel"),
                ::testing::ElementsAre(left_out + "box@5\n", "box@4 cpu_parallel float32"));
    // A backend that no scene has is added to each scene, once.
    EXPECT_THAT(rows_of("cpu_parallel:precision=float64"),
                ::testing::ElementsAre("", "box@4 cpu_parallel float64", "box@5 cpu_parallel float64"));
    EXPECT_THAT(rows_of("!cpu_reference"),
                ::testing::ElementsAre(left_out + "box@5\n", "box@4 cpu_parallel float32"));
}

TEST_F(StudyKinds, StepsBeyondWhatCanBeCountedAreRefused) {
    Study study = study_of("fastest", {{"box@4", 900000000, {}}});
    study.scenes[0].settings = {{"rewind", false}};
    expect_contains(refusal([&] { (void)run_study(study, {}); }), "900000000");
}

TEST_F(StudyKinds, AStudyThatMeasuredNothingFails) {
    (void)write("loose.json", R"({"dataset": {"type": "box", "dims": [1, 1, 1]}, "time_step": 0.1})");
    const std::string file = write("nothing.json", R"({"kind": "stability", "backends": ["cpu_reference"],
        "scenes": [{"scene": "loose.json"}]})");
    std::ostringstream printed;
    EXPECT_EQ(run_and_print_study(file, {}, printed), 1) << printed.str();
    expect_contains(printed.str(), "nothing was measured");
}

}  // namespace
}  // namespace voxspring::testing
