// Rows of results, Google Benchmark's format, statistics and tables.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/base/progress.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/results/counters.h"
#include "harness/results/google_benchmark.h"
#include "harness/results/print.h"
#include "harness/results/row.h"
#include "harness/results/table.h"

namespace voxspring::testing {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;

TEST(Statistics, AreThoseOfASample) {
    EXPECT_DOUBLE_EQ(median({3, 1, 2}), 2);
    EXPECT_DOUBLE_EQ(median({4, 1, 3, 2}), 2.5) << "the mean of the two in the middle";
    EXPECT_DOUBLE_EQ(mean({1, 2, 6}), 3);
    EXPECT_DOUBLE_EQ(standard_deviation({1, 2, 3, 4}), std::sqrt(5.0 / 3));
    EXPECT_DOUBLE_EQ(standard_deviation({7}), 0);
    EXPECT_DOUBLE_EQ(quantile({5, 1, 2, 4, 3}, 0.25), 2);
    EXPECT_DOUBLE_EQ(quantile({1, 2}, 0.75), 1.75) << "between two of them";
    EXPECT_DOUBLE_EQ(relative_spread({8, 9, 10, 11, 12}), 0.1);
}

TEST(Histograms, PercentilesAreValuesOfTheirRank) {
    std::vector<double> sorted;
    for (int n = 1; n <= 200; ++n) sorted.push_back(n);
    EXPECT_EQ(percentile(sorted, 0.5), 100);
    EXPECT_EQ(percentile(sorted, 0.99), 198);
    EXPECT_EQ(percentile(sorted, 0.999), 200);
    EXPECT_EQ(percentile({7}, 0.5), 7);
}

TEST(Histograms, ValuesAreInTheBinThatBeginsAtOrBelowThem) {
    // For every bin its begin, a value just below it, and its middle.
    const double ratio = std::pow(10, 1.0 / bins_per_decade);
    std::vector<double> values;
    for (const auto& [begin, count] : histogram_of({1e-7, 2.5e-6, 3e-5, 4.7e-4, 0.9})) {
        EXPECT_EQ(count, 1);
        for (const double value : {begin, begin * (1 - 1e-9), begin * std::sqrt(ratio)})
            values.push_back(value);
    }
    std::sort(values.begin(), values.end());
    std::int64_t total = 0;
    std::size_t next = 0;
    for (const auto& [begin, count] : histogram_of(values)) {
        for (std::int64_t n = 0; n < count; ++n, ++next) {
            EXPECT_TRUE(values[next] >= begin || next == 0) << values[next];
            EXPECT_LT(values[next], begin * ratio * (1 - 1e-12)) << begin;
        }
        total += count;
    }
    EXPECT_EQ(total, 15);
}

TEST(Histograms, WhatLiesBeyondTheBinsIsInTheFirstAndTheLast) {
    const Histogram histogram = histogram_of({0, 1e-9, 1e-7, 2, 1e9});
    ASSERT_EQ(histogram.size(), 2u);
    EXPECT_DOUBLE_EQ(histogram[0].first, histogram_begin);
    EXPECT_EQ(histogram[0].second, 3);
    EXPECT_DOUBLE_EQ(histogram[1].first * std::pow(10, 1.0 / bins_per_decade), histogram_end);
    EXPECT_EQ(histogram[1].second, 2);
}

Row timed_row() {
    Row row = row_of("box@4", BackendSpec::parse("cpu_reference"));
    row.workpiece = Workpiece{.steps = 10, .particles = 64, .springs = 300};
    row.limit = LimitPart{.seconds = 1e-6,
                          .limited_by = "bandwidth",
                          .bytes = 9000,
                          .written_bytes = 3000,
                          .footprint_bytes = 6000,
                          .operations = 700};
    return row;
}

TEST(GoogleBenchmark, RowsAreItsOwnForWhatWasMeasured) {
    const auto rows =
        google_benchmark_rows(timed_row(), {{2e-5, 3e-5, 4e-5}, {4e-5, 5e-5, 6e-5}, {9e-5, 9e-5, 9e-5}}, 7);
    ASSERT_EQ(rows.size(), 3u + 4u);
    const nlohmann::json first = to_json(rows[0]);
    EXPECT_EQ(first.at("name"), "box@4/cpu_reference/increment/float64/iterations:10/repeats:3/manual_time");
    EXPECT_EQ(first.at("run_name"), first.at("name"));
    EXPECT_EQ(first.at("run_type"), "iteration");
    EXPECT_EQ(first.at("repetition_index"), 0);
    EXPECT_EQ(first.at("family_index"), 7);
    EXPECT_EQ(first.at("iterations"), 10);
    EXPECT_EQ(first.at("threads"), 1);
    EXPECT_DOUBLE_EQ(first.at("real_time"), 2) << "microseconds a step";
    EXPECT_DOUBLE_EQ(first.at("cpu_time"), 4);
    EXPECT_DOUBLE_EQ(first.at("particle_updates_per_second"), 64 * 10 / 2e-5);
    EXPECT_DOUBLE_EQ(first.at("fraction_of_limit"), 0.5);
    EXPECT_EQ(first.at("step_bytes"), 9000);
    EXPECT_EQ(first.at("step_written_bytes"), 3000);
    EXPECT_EQ(first.at("step_footprint_bytes"), 6000);
    EXPECT_EQ(first.at("step_operations"), 700);
    EXPECT_FALSE(first.contains("aggregate_name"));

    const nlohmann::json median_row = to_json(rows[4]);
    EXPECT_EQ(median_row.at("aggregate_name"), "median");
    EXPECT_EQ(median_row.at("aggregate_unit"), "time");
    EXPECT_EQ(median_row.at("name"), std::string(first.at("name")) + "_median");
    EXPECT_EQ(median_row.at("iterations"), 3) << "the number of repetitions, as Google Benchmark has it";
    EXPECT_DOUBLE_EQ(median_row.at("real_time"), 4);
    EXPECT_FALSE(median_row.contains("repetition_index"));
    EXPECT_TRUE(rows[4].benchmark->is_median());

    const nlohmann::json spread = to_json(rows[6]);
    EXPECT_EQ(spread.at("aggregate_name"), "cv");
    EXPECT_EQ(spread.at("aggregate_unit"), "percentage");
    EXPECT_DOUBLE_EQ(spread.at("real_time"), std::sqrt(13.0) / 5);
    EXPECT_TRUE(spread.at("fraction_of_limit").is_null());
    EXPECT_EQ(google_benchmark_rows(timed_row(), {{1, 1, 1}}, 0).size(), 1u) << "no statistics of one";
}

TEST(AboveLimit, IsMarkedAndNamed) {
    Row row = timed_row();
    row.limit->fraction = 1;
    EXPECT_EQ(row.limit_mark(), "");
    std::ostringstream out;
    print_above_limit({row}, out);
    EXPECT_EQ(out.str(), "");
    Row above = row;
    above.limit->fraction = 1.039;
    EXPECT_EQ(above.limit_mark(), "!");
    print_above_limit({row, above}, out);
    EXPECT_EQ(out.str(),
              "! faster than its limit, so the limit is wrong:\n"
              "    box@4 cpu_reference increment float64 (103.9 %)\n");
}

TEST(GoogleBenchmark, ContextIsOfThisBuild) {
    const nlohmann::json context = google_benchmark_context();
#ifdef NDEBUG
    EXPECT_EQ(context.at("library_build_type"), "release");
#endif
    for (const char* key : {"date", "executable", "num_cpus", "mhz_per_cpu", "caches", "load_avg"})
        EXPECT_TRUE(context.contains(key)) << key;
    EXPECT_FALSE(context.contains("host_name")) << "results are published";
}

TEST(GoogleBenchmark, ContextCountsOnlyProcessorsThatTheProcessMayUse) {
    cpu_set_t before, one;
    ASSERT_EQ(sched_getaffinity(0, sizeof before, &before), 0);
    CPU_ZERO(&one);
    CPU_SET(sched_getcpu(), &one);
    ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
    const int pinned = google_benchmark_context().at("num_cpus"), processors = omp_get_num_procs();
    ASSERT_EQ(sched_setaffinity(0, sizeof before, &before), 0);
    // LLVM's OpenMP, with which the sanitizers run, counts the processors only once.
    EXPECT_EQ(pinned, processors);
    EXPECT_EQ(google_benchmark_context().at("num_cpus"), CPU_COUNT(&before));
}

TEST(Row, IsReadAsItWasWritten) {
    Row row = google_benchmark_rows(timed_row(), {{2e-5, 3e-5, 4e-5}}, 0).front();
    row.errors.emplace();
    row.errors->relative_l2 = 1e-7;
    row.errors->worst_particle = 3;
    row.start =
        StartPart{.construct_seconds = 1, .compile_seconds = 2, .upload_seconds = 3, .ready_seconds = 6};
    row.choice = ChoicePart{.chosen = "tile=64x16", .predicted_seconds = 7e-6};
    row.edits =
        EditPart{.edits = 2, .median_seconds = 1e-5, .max_seconds = 2e-5, .seconds_per_step_without = 1e-6};
    row.reference = ReferencePart{.voxels = 64, .error_steps = 10, .reference = "cpu_reference"};
    row.verdict = VerdictPart{.passed = true, .finite = true, .error_rms = 1e-9, .tolerance = INFINITY};
    row.noisy = {"it rained (twice)"};
    row.min_card_mhz = 1905;
    row.max_card_mhz = 1980;
    row.reason = "why";
    const nlohmann::json json = to_json(row);
    EXPECT_TRUE(json.at("tolerance").is_null()) << "JSON has no infinity";
    EXPECT_TRUE(json.at("total_error_max").is_null());
    EXPECT_EQ(to_json(row_from_json(json)), json);
    const nlohmann::json bare = to_json(row_of("box@4", BackendSpec::parse("cpu_reference")));
    EXPECT_EQ(bare.size(), 6u) << "its identity alone: " << bare;
    EXPECT_EQ(to_json(row_from_json(bare)), bare);
}

TEST(Table, AQuietTimeStandsAloneAndASpreadIsGivenFromThreePercentOn) {
    const std::vector<Row> rows = google_benchmark_rows(
        timed_row(), {{1.8e-5, 0, 0}, {1.9e-5, 0, 0}, {2e-5, 0, 0}, {2.1e-5, 0, 0}, {2.2e-5, 0, 0}}, 0);
    Row row = rows.front();
    const double seconds = row.step_seconds();
    StepTimes times = step_times_of(rows);
    ASSERT_EQ(times.at(row.case_key()).size(), 5u);
    EXPECT_EQ(time_text(row, seconds, times), si(seconds, "s") + " +-5%");
    row.noisy = {"it rained"};
    EXPECT_EQ(time_text(row, seconds, times), "~" + si(seconds, "s") + " +-5%");
    times.begin()->second = {10, 10.1, 10.2, 10.3, 10.4};
    EXPECT_EQ(time_text(row, seconds, times), "~" + si(seconds, "s"));
    EXPECT_EQ(time_text(row, seconds, {}), "~" + si(seconds, "s"));
}

TEST(Table, DropsColumnsAndShortensNamesWhereThereIsNoRoom) {
    const std::vector<Column> columns = {
        {"scene", 0, true}, {"backend", 0, true}, {"time"}, {"springs/s", 2}, {"error", 1}};
    const std::vector<std::vector<std::string>> rows = {
        {"box@32", "gl_fragment_implicit increment float32 mask=none", "1.2 us", "3 G/s", "1e-7"}};
    const auto lines = [&](TableWidth width) {
        std::ostringstream out;
        print_columns(columns, rows, width, out);
        std::vector<std::string> all;
        std::istringstream text(out.str());
        for (std::string line; std::getline(text, line);) all.push_back(line);
        return all;
    };
    EXPECT_NE(lines(0)[1].find("mask=none"), std::string::npos) << "no terminal, no limit";
    EXPECT_NE(lines(0)[0].find("springs/s"), std::string::npos);
    for (const TableWidth width : {30u, 45u, 60u, 80u}) {
        for (const std::string& line : lines(width)) EXPECT_LE(line.size(), width) << line;
        EXPECT_NE(lines(width)[1].find("1.2 us"), std::string::npos) << "the time stays";
    }
    EXPECT_EQ(lines(45)[0].find("springs/s"), std::string::npos) << "the most expendable goes first";
    EXPECT_NE(lines(80)[1].find("..."), std::string::npos);
    EXPECT_EQ(shortened("abcdefghijkl", 9), "abcd...kl");
}

TEST(Table, IsCutAndAlignedByCharacters) {
    EXPECT_EQ(shortened("äöüäöüäöüäöü", 9), "äöüä...öü");
    EXPECT_EQ(shortened("äöüä", 4), "äöüä");
    EXPECT_EQ(shortened("äöüä", 3), "äöü");
    const std::vector<std::vector<std::string>> rows = {{"Herzmuskel für Übungen", "1 us"},
                                                        {"heart", "20 us"}};
    const auto printed = [&](TableWidth width) {
        std::ostringstream out;
        print_columns({{"scene", 0, true}, {"time"}}, rows, width, out);
        return out.str();
    };
    EXPECT_EQ(printed(0),
              "scene                    time\n"
              "Herzmuskel für Übungen   1 us\n"
              "heart                   20 us\n");
    EXPECT_EQ(printed(22),
              "scene             time\n"
              "Herzmusk...ngen   1 us\n"
              "heart            20 us\n");
}

// At 80 columns these two rows once had the same text.
TEST(Table, NamesThatDifferStayApart) {
    const std::vector<Column> columns = {{"scene", 0, true}, {"backend", 0, true}, {"time"}, {"error", 1}};
    const std::vector<std::vector<std::string>> rows = {
        {"a heart", "cuda_implicit_device increment float32", "1.2 us", "1e-7"},
        {"a heart", "cuda_implicit_cached increment float32", "1.1 us", "1e-7"}};
    for (const TableWidth width : {20u, 48u, 80u}) {
        std::ostringstream out;
        print_columns(columns, rows, width, out);
        EXPECT_NE(out.str().find("cuda_implicit_d"), std::string::npos) << width << "\n" << out.str();
        EXPECT_NE(out.str().find("cuda_implicit_c"), std::string::npos) << width << "\n" << out.str();
        EXPECT_EQ(out.str().find("no room for: error") == std::string::npos, width == 80) << out.str();
    }
}

TEST(Unmeasured, TakesOneLineAReason) {
    Result result;
    for (const char* scene : {"a", "b", "c", "d"}) {
        for (const char* backend : {"cuda_one", "cuda_two", "cuda_three", "cuda_four"}) {
            Row row{.identity = {.name = std::string(scene) + "/" + backend + "/increment/float32",
                                 .scene = scene,
                                 .backend = backend}};
            row.reason = "no driver";
            result.rows("skipped").push_back(row);
        }
    }
    std::ostringstream out;
    print_unmeasured(result, out);
    EXPECT_EQ(out.str(), "skipped: 4 cuda_* backends on 4 scenes: no driver\n");
    EXPECT_EQ(names_in_short({"a", "b"}), "a, b");
    EXPECT_EQ(names_in_short({"a_1", "b_1", "c_1", "d_1"}), "4 backends");
}

TEST(Table, WrapsHeadingsBeforeItCutsNamesAndNamesWhatItHasNoRoomFor) {
    const std::vector<Column> columns = {
        {"backend", 0, true}, {"error against the converged solution", 2}, {"particles/s", 1}, {"time"}};
    const std::vector<std::vector<std::string>> rows = {
        {"gl_fragment_implicit increment float32 mask=none", "1e-7", "3 G/s", "1.2 us"}};
    const auto printed = [&](TableWidth width) {
        std::ostringstream out;
        print_columns(columns, rows, width, out);
        return out.str();
    };
    const std::string name = rows[0][0], wide(name.size(), ' ');
    EXPECT_EQ(printed(90),
              wide + "      error                     \n" + wide + "    against                     \n" +
                  wide + "        the                     \n" + wide + "  converged                     \n" +
                  "backend" + wide.substr(7) + "   solution  particles/s    time\n" + name +
                  "       1e-7        3 G/s  1.2 us\n");
    EXPECT_THAT(printed(70),
                HasSubstr("gl_fragment_implicit inc...2 mask=none       1e-7        3 G/s  1.2 us\n"));
    EXPECT_EQ(printed(45),
              "backend                   particles/s    time\ngl_fragment_im...sk=none        3 G/s  1.2 us\n"
              "no room for: error against the converged solution\n");
    EXPECT_THAT(printed(0), ::testing::Not(HasSubstr("no room")));
}

// Catches a row that nothing could fail and that looks as good as others, and a bound whose run is not named.
TEST(Thresholds, SayWhichRunVerifiesARowAndWhichRowNoneDoes) {
    const double infinite = std::numeric_limits<double>::infinity();
    const VerdictPart own{.passed = true,
                          .finite = true,
                          .tolerance = 1e-3,
                          .tolerance_rms = 2e-4,
                          .motion_max = 2,
                          .motion_rms = 1,
                          .repetitions_judged = 9,
                          .strained_share = 0.9};
    VerdictPart falling = own, verified = own, chaotic = own, old = own, still = own, unknown = own;
    falling.strained_share = 0.01;
    verified.strained_share = 0.01;
    verified.strained_start = StrainedPart{
        .share = 0.99, .tolerance = 1e-4, .tolerance_rms = infinite, .motion_max = 0.2, .motion_rms = 0.1};
    chaotic.tolerance = chaotic.tolerance_rms = infinite;
    chaotic.strained_share = 0;
    old.strained_share.reset();
    old.repetitions_judged.reset();
    still.motion_max = still.motion_rms = 0;
    unknown.motion_max.reset();
    unknown.motion_rms.reset();
    Result result;
    for (const auto& [name, verdict] : {std::pair("own", own),
                                        {"falling", falling},
                                        {"verified", verified},
                                        {"chaotic", chaotic},
                                        {"old", old},
                                        {"still", still},
                                        {"unknown", unknown}}) {
        Row row{.identity = {.name = std::string("a/") + name, .scene = "a"}};
        row.verdict = verdict;
        result.rows("verification").push_back(row_from_json(to_json(row)));
    }
    const Verdicts verdicts = verdicts_of(result);
    std::map<std::string, std::string> texts;
    for (const Row& row : result.rows("verification")) texts[row.label()] = threshold_text(row, verdicts);
    const std::map<std::string, std::string> expected = {
        {"own", "2.0e-04"},     {"falling", "not verified"}, {"verified", "5.0e-04*"},
        {"chaotic", "chaotic"}, {"old", "2.0e-04"},          {"still", "-"},
        {"unknown", "-"}};
    EXPECT_EQ(texts, expected);
    EXPECT_EQ(threshold_text(Row{.identity = {.name = "a/b", .scene = "a"}}, verdicts), "-");
    EXPECT_EQ(verdicts.at({"a/old"}).verified(), std::nullopt);
    // Verdicts of older files do not say their steps.
    const Row timed{.identity = {.name = "a/own/iterations:9", .scene = "a"},
                    .workpiece = Workpiece{9, 1, 1}};
    EXPECT_EQ(threshold_text(timed, verdicts), "2.0e-04");
    std::ostringstream out;
    print_thresholds(result.rows("verification"), verdicts, out);
    EXPECT_THAT(out.str(), HasSubstr("2 of 7 times not verified"));
    EXPECT_THAT(out.str(), HasSubstr("a: falling, chaotic"));
}

TEST(Text, NumbersHaveThreeDigitsAndAPrefixOfTheirSize) {
    EXPECT_EQ(si(1.25e-3, "s"), "1.25 ms");
    EXPECT_EQ(si(-1.25e-3, "s"), "-1.25 ms");
    EXPECT_EQ(si(-48.7e9, "/s"), "-48.7 G/s");
    EXPECT_EQ(si(0, "s"), "0 s");
    EXPECT_EQ(si(2e-12, "s"), "0.00 ns");
    EXPECT_EQ(three_digits(0), "0");
    EXPECT_EQ(three_digits(-0.0123456), "-0.0123");
    EXPECT_EQ(three_digits(999.4), "999");
    EXPECT_EQ(three_digits(29449), "29449");
}

TEST(Counters, HaveAPrefixOnlyWithAUnit) {
    const auto text = [](double value, Unit unit) { return Counter{"a_counter", value, unit}.text(); };
    EXPECT_EQ(text(0.004, Unit::number), "0.004");
    EXPECT_EQ(text(3, Unit::number), "3");
    EXPECT_EQ(text(4e6, Unit::byte), "4.00 MB");
    EXPECT_EQ(text(2e9, Unit::per_joule), "2.00 G/J");
    EXPECT_EQ((Counter{"a_counter", std::nullopt}.text()), "-");
}

TEST(Text, CountsAreOfOneOrOfSeveral) {
    EXPECT_EQ(counted(1, "step"), "1 step");
    EXPECT_EQ(counted(0, "step"), "0 steps");
    EXPECT_EQ(counted(12, "row"), "12 rows");
}

TEST(Progress, EstimatesByTheCasesThatCanRun) {
    setenv("VOXSPRING_PROGRESS_SECONDS", "0.01", 1);
    ::testing::internal::CaptureStderr();  // not a terminal
    Progress progress({{.cases = 100, .rows_per_case = 1, .work_per_case = 1},
                       {.cases = 10, .rows_per_case = 2, .work_per_case = 4}});
    const auto show = [&](const char* what, int done, int total) {
        progress.show(what, done, total);
        std::this_thread::sleep_for(std::chrono::milliseconds(50));  // time for it to be written
    };
    progress.begin("first");
    show("all of it", 0, 100);
    progress.expect(0, 2);
    show("two of it", 1, 2);
    progress.end(1);
    progress.begin("second");
    progress.expect(1, 5);
    show("half of it", 1, 2);
    const std::string said = ::testing::internal::GetCapturedStderr();
    unsetenv("VOXSPRING_PROGRESS_SECONDS");

    EXPECT_THAT(said, HasSubstr("[1/2] first 0/100, 0/120 rows: all of it\n"));
    EXPECT_THAT(said, ContainsRegex("first 1/2, 0/22 rows, about [^\n]* left: two of it\n"));
    EXPECT_THAT(said, ContainsRegex("second 1/2, 2/12 rows, about [^\n]* left: half of it\n"));
}

TEST(Progress, IsHeardInAPipeWhileNothingEnds) {
    setenv("VOXSPRING_PROGRESS_SECONDS", "0.05", 1);
    ::testing::internal::CaptureStderr();
    {
        Progress progress({{.cases = 1, .rows_per_case = 1, .work_per_case = 1}});
        progress.begin("a scene");
        progress.show("a long case", 0, 1);
        std::this_thread::sleep_for(std::chrono::milliseconds(1200));
    }
    const std::string said = ::testing::internal::GetCapturedStderr();
    unsetenv("VOXSPRING_PROGRESS_SECONDS");
    EXPECT_GT(std::count(said.begin(), said.end(), '\n'), 5) << said;
    EXPECT_THAT(said, HasSubstr("[1/1] a scene 0/1, 0/1 row: a long case\n"));
    EXPECT_THAT(said, HasSubstr("[1/1] a scene 0/1, 0/1 row: a long case, 1 s\n"));
}

}  // namespace
}  // namespace voxspring::testing
