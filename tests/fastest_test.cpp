// The study `fastest` and the rules of `--backend auto`, on made-up results, on every committed one and live.
#include "harness/study/fastest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "backends/outpaced.h"
#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/choice/auto_choice.h"
#include "harness/results/capabilities.h"
#include "harness/results/print.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/study.h"
#include "harness/study/study_kind.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

nlohmann::json row_of(const std::string& scene, const std::string& backend, double microseconds,
                      const std::string& tuning = "") {
    const std::string name =
        scene + "/" + backend + "/position/float32" + (tuning.empty() ? "" : "/" + tuning);
    return {{"name", name + "/iterations:10/repeats:5/manual_time_median"},
            {"run_type", "aggregate"},
            {"aggregate_name", "median"},
            {"repetitions", 5},
            {"scene", scene},
            {"backend", backend},
            {"formulation", "position"},
            {"precision", "float32"},
            {"tuning", tuning},
            {"particles", 1000000},
            {"springs", 8000000},
            {"voxels", 1000000},
            {"real_time", microseconds},
            {"particle_updates_per_second", 1e12 / microseconds},
            {"spring_updates_per_second", 8e12 / microseconds},
            {"ready_seconds", 0.25},
            {"limit_seconds", 20e-6},
            {"limited_by", "bandwidth"},
            {"fraction_of_limit", 20 / microseconds},
            {"error_relative_l2", 1e-7},
            {"error_max", 1e-6},
            {"error_steps", 10},
            {"reference", "cpu_reference"}};
}

/// A result measured on a card, with these `rows`.
nlohmann::json result_of(const std::vector<nlohmann::json>& rows) {
    nlohmann::json backends = nlohmann::json::object();
    for (const auto& row : rows) {
        const std::string name = row.at("backend");
        const std::string device = name.starts_with("cpu") ? "a processor" : "a card";
        backends[name] = {{"api", name.starts_with("cuda") ? "CUDA 13.0" : "another"}, {"device", device}};
    }
    return {{"context", {{"voxspring", {{"backends", backends}, {"limits", nlohmann::json::object()}}}}},
            {"benchmarks", rows},
            {"skipped", nlohmann::json::array()},
            {"failed", nlohmann::json::array()}};
}

TEST(Fastest, IsTheLeastMedianOfEachDataset) {
    std::vector<nlohmann::json> rows = {row_of("a", "cpu_parallel", 90), row_of("a", "cuda_fast", 30),
                                        row_of("a", "cuda_implicit_shared", 75),
                                        row_of("b", "cuda_scatter", 7)};
    // Only medians count.
    rows.push_back(row_of("a", "cuda_scatter", 1));
    rows.back()["aggregate_name"] = "stddev";
    const std::vector<nlohmann::json> blocks = fastest_of(read_result(result_of(rows)), {});
    ASSERT_EQ(blocks.size(), 2u);
    EXPECT_EQ(blocks[0].at("name"), "a/cuda_fast/position/float32");
    EXPECT_DOUBLE_EQ(blocks[0].at("seconds_per_step"), 30e-6);
    EXPECT_EQ(blocks[0].at("device"), "a card");
    EXPECT_EQ(blocks[0].at("paper").at("name"), "a/cuda_implicit_shared/position/float32");
    EXPECT_DOUBLE_EQ(blocks[0].at("paper").at("ratio"), 2.5);
    EXPECT_TRUE(blocks[1].at("paper").is_null()) << "scatter is not of the paper";
    EXPECT_TRUE(blocks[0].at("targets").empty());
}

TEST(Fastest, IsChosenByHalfOfTheRepetitionsAndReportedByTheOthers) {
    const auto case_of = [](const std::string& backend, const std::vector<double>& microseconds) {
        std::vector<nlohmann::json> rows;
        for (std::size_t n = 0; n < microseconds.size(); ++n) {
            rows.push_back(row_of("a", backend, microseconds[n]));
            rows.back().erase("aggregate_name");
            rows.back()["run_type"] = "iteration";
            rows.back()["repetitions"] = microseconds.size();
            rows.back()["repetition_index"] = n;
        }
        rows.push_back(row_of("a", backend, 10));  // stands for the median
        return rows;
    };
    std::vector<nlohmann::json> rows = case_of("cuda_lucky", {6, 12, 6, 12, 6, 12, 6, 12, 6});
    for (auto& row : case_of("cuda_steady", {9, 9, 9, 9, 9, 9, 9, 9, 9})) rows.push_back(std::move(row));
    const nlohmann::json block = fastest_of(read_result(result_of(rows)), {}).at(0);
    EXPECT_EQ(block.at("name"), "a/cuda_lucky/position/float32");
    EXPECT_DOUBLE_EQ(block.at("seconds_per_step"), 12e-6) << "its luck is not in its time";
    EXPECT_DOUBLE_EQ(block.at("particle_updates_per_second"),
                     row_of("a", "cuda_lucky", 10).at("particle_updates_per_second").get<double>() * 10 / 12);
    EXPECT_EQ(block.at("chosen_from"), 2);
}

// Catches a time, a spread or a verdict that mixes two numbers of steps of one case.
TEST(Fastest, EachNumberOfStepsHasItsOwn) {
    std::vector<nlohmann::json> rows, verdicts;
    for (const auto& [steps, microseconds] : {std::pair(40, 10.0), {400, 20.0}}) {
        for (int n = 0; n < 9; ++n) {
            rows.push_back(row_of("a", "cuda_fast", microseconds * (n % 3 == 0 ? 1 : 1.01)));
            rows.back().erase("aggregate_name");
            rows.back().update({{"run_type", "iteration"}, {"repetition_index", n}, {"steps", steps}});
        }
        rows.push_back(row_of("a", "cuda_fast", microseconds));
        rows.back()["steps"] = steps;
        verdicts.push_back(row_of("a", "cuda_fast", microseconds));
        verdicts.back().update({{"steps", steps},
                                {"name", "a/cuda_fast/position/float32"},
                                {"passed", true},
                                {"tolerance_rms", 1e-4 * steps},
                                {"motion_rms", 1}});
    }
    nlohmann::json json = result_of(rows);
    json["verification"] = verdicts;
    json["context"]["voxspring"]["study"] = {{"repetitions", 9}};
    Result result = read_result(json);
    const std::vector<nlohmann::json> blocks = fastest_of(result, {});
    ASSERT_EQ(blocks.size(), 2u);
    EXPECT_DOUBLE_EQ(blocks[0].at("seconds_per_step"), 10.1e-6);
    EXPECT_DOUBLE_EQ(blocks[1].at("seconds_per_step"), 20.2e-6);
    result.rows<nlohmann::json>("fastest") = blocks;
    std::ostringstream out;
    print_fastest(result, out, TableWidth());
    EXPECT_THAT(out.str(), HasSubstr(" 4.0e-03 "));
    EXPECT_THAT(out.str(), HasSubstr(" 4.0e-02 "));
    EXPECT_THAT(out.str(), HasSubstr("a position float32, 40 steps: auto takes"));
    EXPECT_THAT(out.str(), HasSubstr("a position float32, 400 steps: auto takes"));
    std::ostringstream table;
    print_table(result, table);
    EXPECT_THAT(table.str(), Not(HasSubstr(" 2.00 "))) << "a row is compared with the fastest of its steps";
    EXPECT_THAT(table.str(), HasSubstr(" 1.00 "));
    EXPECT_THAT(out.str(), Not(HasSubstr("+-")))
        << "the times of each differ by 1%, and those of both by 100%";
}

TEST(Fastest, ThePapersAreBackendsOfThisSource) {
    for (const std::string& name : paper_backends())
        EXPECT_TRUE(registry().contains(name) || left_out().contains(name)) << name;
}

TEST(Fastest, TargetsAreMetOrMissedByTheBackendsThatTheyAreAbout) {
    const nlohmann::json result = result_of({row_of("a", "cpu_parallel", 10), row_of("a", "cuda_fast", 25),
                                             row_of("a", "gl_compute_implicit", 50)});
    const auto judged = [&](Quantity quantity, double value, const std::string& backends,
                            const std::string& over = "") {
        Target target{"a", "position", "float32", backends, over, quantity, value};
        return fastest_of(read_result(result), {target})[0].at("targets").at(0);
    };
    auto target = judged(Quantity::seconds_per_step, 20e-6, "cuda_*");
    EXPECT_EQ(target.at("name"), "a/cuda_fast/position/float32");
    EXPECT_EQ(target.at("met"), false);
    EXPECT_DOUBLE_EQ(target.at("reached"), 0.8);
    target = judged(Quantity::seconds_per_step, 20e-6, "*");
    EXPECT_EQ(target.at("met"), true);
    EXPECT_DOUBLE_EQ(target.at("reached"), 2);
    target = judged(Quantity::particle_updates_per_second, 5e10, "cuda_*");
    EXPECT_EQ(target.at("met"), false);
    EXPECT_DOUBLE_EQ(target.at("reached"), 0.8);
    EXPECT_EQ(judged(Quantity::fraction_of_limit, 0.8, "cuda_*").at("met"), true);
    EXPECT_EQ(judged(Quantity::ready_seconds, 0.2, "cuda_*").at("met"), false);
    target = judged(Quantity::speed_ratio, 0.95, "gl_*", "cuda_*");
    EXPECT_DOUBLE_EQ(target.at("measured"), 0.5);
    EXPECT_EQ(target.at("over"), "cuda_*");
    EXPECT_EQ(target.at("met"), false);
    target = judged(Quantity::seconds_per_step, 1, "vulkan_*");
    EXPECT_TRUE(target.at("met").is_null());
    EXPECT_TRUE(target.at("measured").is_null());
    EXPECT_TRUE(judged(Quantity::speed_ratio, 1, "gl_*", "vulkan_*").at("met").is_null());
    const Target elsewhere{"b", "position", "float32", "*", "", Quantity::seconds_per_step, 1};
    EXPECT_TRUE(fastest_of(read_result(result), {elsewhere})[0].at("targets").empty());
}

TEST(Fastest, StartWithinItsSpreadDecidesNoTarget) {
    nlohmann::json row = row_of("a", "cuda_fast", 25);  // ready after 0.25 s, give or take 0.05 s
    row["ready_spread"] = 0.2;
    row["counters"] = {{{"name", "ready_spread"}, {"unit", ""}, {"better", "neither"}}};
    Result result = read_result(result_of({row}));
    const auto target = [](double seconds) {
        return Target{"a", "position", "float32", "*", "", Quantity::ready_seconds, seconds};
    };
    const Target slower{"a", "position", "float32", "*", "", Quantity::seconds_per_step, 24e-6};
    const std::vector<nlohmann::json> blocks =
        fastest_of(result, {target(0.19), target(0.24), target(0.26), target(0.31), slower});
    const nlohmann::json& judged = blocks[0].at("targets");
    EXPECT_EQ(judged[0].at("met"), false);
    EXPECT_TRUE(judged[1].at("met").is_null()) << judged[1];
    EXPECT_EQ(judged[1].at("measured"), 0.25);
    EXPECT_TRUE(judged[2].at("met").is_null()) << judged[2];
    EXPECT_EQ(judged[3].at("met"), true);
    EXPECT_EQ(judged[4].at("met"), false) << "the spread is that of starts, not of steps";
    result.rows<nlohmann::json>("fastest") = blocks;
    std::ostringstream out;
    print_fastest(result, out, TableWidth());
    EXPECT_THAT(out.str(),
                HasSubstr("target for * 240 ms, not decided, within the spread of its starts: 250 ms, 96%"));
    EXPECT_THAT(out.str(), HasSubstr("target for * 190 ms, missed: 250 ms, 76%"));
}

TEST(Fastest, StudySaysWhatItIsMadeOf) {
    Study study;
    study.name = "test";
    study.kind = "fastest";
    study.repetitions = 3;
    StudyScene dense{"box@6", 4, {"cpu_parallel:formulation=*", "auto"}};
    StudyScene onward = dense;
    onward.scene = "heart@20x17x15";
    onward.settings = {{"rewind", false}};
    study.scenes = {dense, onward};
    study.settings = {{"targets",
                       {{{"scene", "box@6"},
                         {"formulation", "increment"},
                         {"backends", "cpu_*"},
                         {"ready_seconds", 100}}}}};
    const nlohmann::json result = run_study(study, {});
    EXPECT_TRUE(result.at("failed").empty()) << result.at("failed");
    const std::size_t formulations = registry().at("cpu_parallel").formulations.size();
    EXPECT_GE(result.at("fastest").size(), 2 * formulations);
    for (const auto& row : result.at("benchmarks")) {
        const bool first = row.at("scene") == "box@6";
        EXPECT_EQ(row.at("error_steps"), first ? 4 : 4 * (1 + 3)) << "the warm-up and three batches";
        EXPECT_EQ(row.at("reference"), "cpu_reference");
        EXPECT_GT(row.at("error_relative_l2"), 0);
        EXPECT_GT(row.at("upload_seconds"), 0);
        EXPECT_DOUBLE_EQ(row.at("ready_seconds"), double(row.at("construct_seconds")) +
                                                      double(row.at("compile_seconds")) +
                                                      double(row.at("upload_seconds")));
    }
    std::size_t judged = 0;
    for (const auto& block : result.at("fastest")) {
        EXPECT_LE(block.at("warm_ready_seconds"), block.at("ready_seconds"));
        judged += block.at("targets").size();
        for (const auto& target : block.at("targets")) EXPECT_EQ(target.at("met"), true);
    }
    EXPECT_EQ(judged, 1u);
    ASSERT_EQ(result.at("auto").size(), 2u);
    EXPECT_EQ(result.at("auto")[0].at("formulation"), "increment") << "the default";

    study.scenes = {{"scalpel_1", 4, {"cpu_parallel"}}};
    study.scenes[0].settings = {{"rewind", false}};
    EXPECT_THROW(run_study(study, {}), BadInput) << "edits are made once";
}

TEST(Auto, RulesNameBackendsAndTuningsThatThereAre) {
    for (const Rule& rule : rules()) {
        EXPECT_LT(rule.min_particles, rule.max_particles) << rule.backend;
        EXPECT_LT(rule.min_occupancy, rule.max_occupancy) << rule.backend;
        if (left_out().contains(rule.backend)) continue;
        EXPECT_NO_THROW(BackendSpec::parse(rule.backend + (rule.tuning.empty() ? "" : ":" + rule.tuning)));
    }
}

TEST(Auto, SomeRuleHoldsForEveryWorkload) {
    const auto of_processor = [](const Workload& workload) {
        return std::any_of(rules().begin(), rules().end(), [&](const Rule& rule) {
            return rule.backend == "cpu_parallel" && holds(rule, workload);
        });
    };
    for (const std::uint64_t particles : {1ull, 30000ull, 1000000ull, 1ull << 31})
        for (const std::uint64_t voxels : {particles, 5 * particles, std::uint64_t(0)})
            for (const bool increments : {false, true})
                EXPECT_TRUE(of_processor({voxels, particles, INFINITY, increments}))
                    << particles << " of " << voxels;
}

TEST(Auto, DescribesWorkloads) {
    EXPECT_EQ(describe({134217728, 134217728}), "a full lattice of 134 million voxels");
    EXPECT_EQ(describe({140760, 29449}), "29449 particles in 21% of 140760 voxels");
    EXPECT_EQ(describe({0, 7}), "7 particles without a lattice");
}

/// The choice for rows on one scene; backends of the rules that are not in `rows` count as unknown.
nlohmann::json choice_of(const std::vector<nlohmann::json>& rows) {
    return choose_among(read_result(result_of(rows)), rows_from_json(rows));
}

TEST(Auto, ChoosesAmongWhatWasMeasured) {
    const auto choice = choice_of({row_of("a", "cpu_parallel", 90), row_of("a", "cuda_implicit_cached", 30),
                                   row_of("a", "cuda_implicit_cached", 20, "fetch=l1")});
    EXPECT_EQ(choice.at("name"), "a/cuda_implicit_cached/position/float32/fetch=l1");
    EXPECT_DOUBLE_EQ(choice.at("times_fastest"), 1);
    EXPECT_THAT(std::string(choice.at("reason")), HasSubstr("a full lattice of 1 million voxels"));
    EXPECT_EQ(choice_of({row_of("a", "cpu_parallel", 90)}).at("name"), "a/cpu_parallel/position/float32");
    // The chosen backend was not measured with that tuning, so there is no second guess.
    EXPECT_TRUE(choice_of({row_of("a", "cpu_parallel", 90), row_of("a", "cuda_implicit_cached", 30)})
                    .at("name")
                    .is_null());
}

// A backend that rebuilds its tables for each edit is no choice for a scene with edits.
TEST(Auto, AsksWhetherSpringsAreEdited) {
    std::vector<nlohmann::json> rows = {row_of("a", "cuda_march", 10), row_of("a", "cpu_parallel", 90)};
    for (auto& row : rows) row["particles"] = row["voxels"] = 10000000;
    EXPECT_EQ(choice_of(rows).at("name"), "a/cuda_march/position/float32");
    for (auto& row : rows) row["edits"] = 10;
    EXPECT_EQ(choice_of(rows).at("name"), "a/cpu_parallel/position/float32");
    const auto between = [](const char* name) {
        return workload_of(load_scene(name), Formulation::increment).steps_between_edits;
    };
    EXPECT_EQ(between("box@4"), INFINITY);
    EXPECT_NEAR(between("scalpel_10"), 100, 10);
    Scene late = load_scene("box@4");
    late.edits.push_back({std::numeric_limits<int>::max(), {}});
    EXPECT_EQ(workload_of(late, Formulation::increment).steps_between_edits, 2147483648.0);
    // A choice that pays with rare edits does not with many.
    for (const Rule& rule : rules()) {
        if (rule.backend != "cuda_resident" || rule.min_particles > 0 || rule.min_occupancy > 0) continue;
        const auto taken = [&](double steps) { return holds(rule, {140760, 29449, steps, rule.increments}); };
        EXPECT_TRUE(taken(INFINITY));
        EXPECT_TRUE(taken(rule.min_steps_between_edits));
        EXPECT_GT(rule.min_steps_between_edits, 0);
        EXPECT_FALSE(taken(rule.min_steps_between_edits / 2));
    }
}

// A backend that takes thousands of steps per launch can take only few per launch while a tool moves. That
// backend itself says that another is then faster. Without a card, `auto` never gets to that backend.
TEST(Auto, GoesOnFromABackendThatAToolSlowsDown) {
    const Scene scene = load_scene("grasp");
    SceneRunner runner(scene);
    const AutoChoice choice = choose_backend(
        "auto", scene, [&](const Backend& backend) { return runner.unsupported(backend).empty(); });
    EXPECT_NE(choice.spec.entry->name, "cuda_resident") << choice.reason;
}

// A spring by increments takes more instructions, so another strategy may be the fastest.
TEST(Auto, AsksForTheFormulation) {
    Workload workload{140760, 29449};
    for (const bool increments : {false, true}) {
        workload.increments = increments;
        for (const Rule& rule : rules()) EXPECT_LE(holds(rule, workload), rule.increments == increments);
    }
    EXPECT_TRUE(workload_of(load_scene("box@4"), Formulation::compensated).increments);
    EXPECT_FALSE(workload_of(load_scene("box@4"), Formulation::position).increments);
}

TEST(Auto, PassesOverWhatTheSceneIsRefusedByAndSoftware) {
    nlohmann::json result =
        result_of({row_of("a", "cpu_parallel", 90), row_of("a", "gl_fragment_implicit", 80),
                   row_of("b", "cuda_implicit_cached", 80, "fetch=l1")});
    const std::vector<Row> rows = {row_from_json(result.at("benchmarks")[0]),
                                   row_from_json(result.at("benchmarks")[1])};
    nlohmann::json refused = row_of("a", "cuda_implicit_cached", 1, "fetch=l1");
    refused["reason"] = "too large";
    result["skipped"].push_back(refused);
    EXPECT_EQ(choose_among(read_result(result), rows).at("name"), "a/gl_fragment_implicit/position/float32");
    result["context"]["voxspring"]["backends"]["gl_fragment_implicit"]["device"] = "llvmpipe, software";
    const auto choice = choose_among(read_result(result), rows);
    EXPECT_EQ(choice.at("name"), "a/cpu_parallel/position/float32");
    EXPECT_DOUBLE_EQ(choice.at("times_fastest"), 90.0 / 80) << "the fastest of all rows, chosen or not";
}

TEST(Capabilities, AreReadAsTheyWereWrittenByAnyVersion) {
    const Capabilities written{.api = "OpenGL 4.5 core",
                               .device = "a card",
                               .driver = "1",
                               .uuid = "GPU-a",
                               .clock = "GL_TIMESTAMP",
                               .deterministic = false,
                               .highest_mhz = {{"sm", 7}},
                               .kernel_compiler = "a compiler -x",
                               .family = "opengl",
                               .is_software = true,
                               .limits_of = "OpenGL"};
    EXPECT_EQ(to_json(capabilities_of(to_json(written))), to_json(written));
    // Version 0.1 wrote neither field, so names decide.
    EXPECT_EQ(capabilities_of({{"api", "CUDA 13.0"}}).family, "cuda");
    EXPECT_EQ(capabilities_of({{"api", "OpenGL compute 4.5 core"}}).family, "opengl");
    EXPECT_TRUE(capabilities_of({{"device", "llvmpipe, software"}}).is_software);
    EXPECT_FALSE(capabilities_of({{"device", "a card"}}).is_software);
}

TEST(Auto, TakesWhatRunsTheSceneOnThisMachine) {
    const Scene scene = load_scene("box@9");
    SceneRunner runner(scene);
    const auto accepts = [&](const Backend& backend) { return runner.unsupported(backend).empty(); };
    const AutoChoice choice = choose_backend("auto:formulation=position,precision=float32", scene, accepts);
    EXPECT_EQ(choice.spec.options.formulation, Formulation::position);
    EXPECT_THAT(choice.reason, HasSubstr("a full lattice of 729 voxels"));
    EXPECT_TRUE(accepts(*choice.backend));
    EXPECT_EQ(choose_backend("auto", scene, accepts).spec.options.formulation, Formulation::increment);
    // The first choice is refused, so the next one is taken.
    const std::string first = choice.spec.entry->name;
    const AutoChoice other =
        choose_backend("auto", scene, [tries = 0](const Backend&) mutable { return ++tries > 1; });
    EXPECT_NE(other.spec.entry->name, first);
    EXPECT_THROW(choose_backend("auto", scene, [](const Backend&) { return false; }), Unavailable);
    EXPECT_THROW(choose_backend("auto:threads=2", scene, accepts), BadSpecification);
    EXPECT_THROW(choose_backend("auto:precision=half", scene, accepts), BadSpecification);
}

class SlowBackend final : public WrappedBackend, public Outpaced {
public:
    std::string outpaced(const Problem&) const override { return "cpu_explicit is faster"; }
};

// What its rules say holds on other devices only.
TEST(Auto, GoesOnFromABackendThatAnotherOneOutpaces) {
    const Scene scene = load_scene("box@4");
    const auto choice = [&] {
        return choose_backend("auto", scene,
                              [](const Backend& backend) { return backend.capabilities().steps_on_host(); });
    };
    EXPECT_EQ(choice().spec.entry->name, "cpu_parallel");
    EXPECT_THAT(choice().reason, Not(HasSubstr("; not ")));
    BackendEntry& entry = const_cast<BackendEntry&>(registry().at("cpu_parallel"));
    EXPECT_THAT(choice().reason, HasSubstr(": " + entry.strength));
    const std::string strength = std::exchange(entry.strength, "");
    EXPECT_THAT(choice().reason, HasSubstr(": a lattice needs no neighbour lists"));
    entry.strength = strength;
    const auto make =
        std::exchange(entry.make, [](const Options&) { return std::make_unique<SlowBackend>(); });
    EXPECT_EQ(choice().spec.entry->name, "cpu_explicit");
    EXPECT_THAT(choice().reason, HasSubstr("; not cpu_parallel: cpu_explicit is faster"));
    entry.make = make;
    EXPECT_EQ(choice().spec.entry->name, "cpu_parallel");
}

TEST(Auto, LeavesSpringsBeyondTheLatticeToLists) {
    Scene scene = load_scene("box@4");
    scene.problem.springs.push_back({0, 63, 1, 5});
    SceneRunner runner(scene);
    const AutoChoice choice = choose_backend(
        "auto", scene, [&](const Backend& backend) { return runner.unsupported(backend).empty(); });
    EXPECT_EQ(choice.backend->unsupported(scene.problem), "");
    EXPECT_THAT(choice.reason, HasSubstr("lists"));
}

/// What is wrong with the rules according to a result of a fastest study: datasets on which their choice was
/// not measured, or takes more than 5% longer than the fastest.
std::vector<std::string> mistakes(const nlohmann::json& result) {
    constexpr double most = 1.05;
    std::vector<std::string> all;
    for (const auto& block : fastest_of(read_result(result), {})) {
        if (block.contains("noisy")) {
            std::cout << block.at("name") << " is too noisy to judge the rules by: " << block.at("noisy")
                      << "\n";
            continue;
        }
        const auto& choice = block.at("auto");
        const std::string reason = choice.at("reason");
        if (choice.at("name").is_null()) {
            all.push_back(std::string(block.at("name")) + " is fastest; not measured: " + reason);
        } else if (const double times = choice.at("times_fastest"); times > most) {
            std::ostringstream text;
            text << block.at("name") << " is fastest; " << times << " times that: " << reason;
            all.push_back(text.str());
        }
    }
    return all;
}

// One card's file may be older than a strategy that another one's has. It says nothing of that strategy, and
// judges the rules by what it has.
TEST(Auto, LeavesOutAStrategyThatAFileLacks) {
    const auto file = [](double march, const std::string& marched) {
        std::vector<nlohmann::json> rows = {row_of("a", "cuda_implicit_cached", 20, "fetch=l1"),
                                            row_of("a", "cpu_parallel", 90)};
        if (march > 0) rows.push_back(row_of(marched, "cuda_march", march));
        for (auto& row : rows) row["particles"] = row["voxels"] = 10000000;
        return result_of(rows);
    };
    const auto chosen = [](const nlohmann::json& result) {
        return fastest_of(read_result(result), {}).at(0).at("auto").at("name");
    };
    const nlohmann::json newer = file(10, "a"), older = file(0, "");
    EXPECT_THAT(mistakes(newer), ::testing::IsEmpty());
    EXPECT_EQ(chosen(newer), "a/cuda_march/position/float32");
    EXPECT_THAT(mistakes(older), ::testing::IsEmpty());
    EXPECT_EQ(chosen(older), "a/cuda_implicit_cached/position/float32/fetch=l1");
    // A file that has the strategy, but not on this body, is of a study whose list forgot it.
    EXPECT_THAT(mistakes(file(10, "b")), ::testing::ElementsAre(HasSubstr(
                                             "a/cuda_implicit_cached/position/float32/fetch=l1 is fastest; "
                                             "not measured: cuda_march")));
}

TEST(Auto, IsWithinATenthOfTheFastestInEveryCommittedResult) {
    int results = 0, judged = 0;
    for (const auto& folder : std::filesystem::directory_iterator(VOXSPRING_RESULTS)) {
        auto path = folder.path() / "fastest.json.gz";
        if (!std::filesystem::exists(path)) path = folder.path() / "fastest.json";
        if (folder.path().filename() == "local" || !std::filesystem::exists(path)) continue;
        ++results;
        auto result = nlohmann::json::parse(read_json(path).value().text());
        EXPECT_THAT(mistakes(result), ::testing::IsEmpty()) << path;
        // If their choice took a million times as long, the same rules would be wrong wherever there was
        // another row.
        int others = 0;
        const std::vector<nlohmann::json> blocks = fastest_of(read_result(result), {});
        for (auto& row : result["benchmarks"]) row.erase("noisy");  // otherwise some could not be judged
        for (const auto& block : blocks) {
            int rows = 0;
            for (auto& row : result["benchmarks"]) {
                if (row.at("scene") != block.at("scene") ||
                    row.at("formulation") != block.at("formulation") ||
                    row.at("precision") != block.at("precision"))
                    continue;
                if (row.value("aggregate_name", "") == "median") ++rows;
                if (block.at("auto").at("name").is_null()) continue;  // a mistake already
                const std::string name = row.at("name"), chosen = block.at("auto").at("name");
                if (name.starts_with(chosen + "/iterations:"))
                    row["real_time"] = 1e6 * row.at("real_time").get<double>();
            }
            others += rows > 1 ? 1 : 0;
        }
        judged += others;  // a processor has only one fast backend
        EXPECT_EQ(mistakes(result).size(), std::size_t(others)) << path;
    }
    EXPECT_GT(results, 0) << "no result of the study fastest in " << VOXSPRING_RESULTS;
    EXPECT_GT(judged, 0) << "nothing to choose from";
}

}  // namespace
}  // namespace voxspring::testing
